# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Counters of rules that outlive the process that counts, in a small file of their own."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.files import replacing
from occ_constraints_pkg.rules.ruleset import RuleCounts, RuleSet
from occ_constraints_pkg.rules.verdict import Judgement

_FORMAT = 'occ_constraints counts 1'


class KeptCounts(RuleCounts):
    """Counts as :class:`RuleCounts` does, and goes on where the file stands.

    Attributes:
        evaluated: (rules,) int64.
        violated: (rules,) int64.
        until_ns: stamp of the newest samples counted, in ns; 0 for none.
        resumed: whether the counters go on from the file.
    """

    def __init__(self, rule_set: RuleSet, path: str | Path = '') -> None:
        """Read the file, if there is one and it counts these rules.

        Args:
            rule_set: the rules to count.
            path: JSON file; none: the counters are not kept.

        Raises:
            OccError: the file cannot be read, or is no file of counters.
        """
        super().__init__(rule_set)
        self._rule_set, self._path = rule_set, path
        # The rule set that the file counts, if it is another one: that file is kept beside.
        self._other = ''
        self.until_ns = 0
        self.resumed = bool(path) and Path(path).exists() and self._read()
        self._is_first = self._is_kept = self.resumed

    def add_stamped(self, judgement: Judgement, stamp_ns: int) -> None:
        """Count the samples of one judgement, unless the process before has done so.

        After a restart a simulation repeats its last samples, which may be counted in the file.
        """
        if not (self._is_first and stamp_ns == self.until_ns):
            self.add(judgement)
            self.until_ns = stamp_ns
            self._is_kept = False
        self._is_first = False

    def reset(self) -> None:
        """Set all counters to zero."""
        super().reset()
        self._is_kept = False

    def keep(self) -> None:
        """Write the file in one move, unless it is up to date.

        Raises:
            OccError: it cannot be written; the file before stays.
        """
        if self._is_kept or not self._path:
            return
        rules = {
            rule.id: {'evaluated': int(evaluated), 'violated': int(violated)}
            for rule, evaluated, violated in zip(
                self._rule_set.rules, self.evaluated, self.violated, strict=True
            )
        }
        document = {
            'format': _FORMAT,
            'rule_set': self._rule_set.fingerprint,
            'until_ns': self.until_ns,
            'rules': rules,
        }
        with replacing(self._path) as draft:
            if self._other:
                Path(self._path).replace(f'{self._path}.{self._other}')
                self._other = ''
            draft.write_text(json.dumps(document, indent=1), encoding='utf-8')
        self._is_kept = True

    def _read(self) -> bool:
        """Take over what the file says; return whether it counts these rules."""
        try:
            document: Any = json.loads(Path(self._path).read_text(encoding='utf-8'))
            if document['format'] != _FORMAT:
                raise ValueError(document['format'])
            if document['rule_set'] != self._rule_set.fingerprint:
                self._other = str(document['rule_set'])
                return False
            counts = [document['rules'][rule.id] for rule in self._rule_set.rules]
            self.evaluated[:] = [item['evaluated'] for item in counts]
            self.violated[:] = [item['violated'] for item in counts]
            self.until_ns = int(document['until_ns'])
        except OSError as error:
            raise OccError(f'cannot read {self._path}: {error.strerror or error}') from error
        except (ValueError, KeyError, TypeError, OverflowError) as error:
            raise OccError(
                f'{self._path} is no file of rule counters; allowed is {_FORMAT!r}'
            ) from error
        return True


def read_counts(path: str | Path, rule_set: RuleSet) -> RuleCounts:
    """Return the counters of these rules that a file holds.

    Raises:
        OccError: it cannot be read, is no file of counters, or counts other rules.
    """
    if not Path(path).exists():
        raise OccError(f'cannot read {path}: there is no such file')
    counts = KeptCounts(rule_set, path)
    if not counts.resumed:
        raise OccError(
            f'{path} counts other rules; allowed are counters of the rule set '
            f'{rule_set.fingerprint}, as a monitor writes them to its counts_file'
        )
    return counts
