# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Rule counters that survive a restart, in a small JSON file."""

from __future__ import annotations

import itertools
import json
import os
import re
from pathlib import Path
from typing import Any

import numpy as np

from occ_constraints_pkg.errors import DataError, OccError
from occ_constraints_pkg.files import COUNTS, read_bytes, replacing
from occ_constraints_pkg.rules.ruleset import RuleCounts, RuleSet
from occ_constraints_pkg.rules.verdict import Judgement

_FORMAT = 'occ_constraints counts 1'
# Counters of 100000 rules take a tenth of it.
_MOST_BYTES = 100_000_000
_DAMAGED = 'damaged'


class PersistentCounts(RuleCounts):
    """Counts as :class:`RuleCounts` does, and continues from a file.

    Attributes:
        evaluated: (rules,) int64.
        violated: (rules,) int64.
        until_ns: stamp of the newest samples counted, in ns; 0 for none.
        resumed: whether the counters continue from the file.
        problem: why the existing file cannot be used, in one sentence; empty if it can. It is
            renamed to ``.damaged`` at the first write.
    """

    def __init__(self, rule_set: RuleSet, path: str | Path = '') -> None:
        """Read the file, if there is one and it counts these rules.

        Args:
            rule_set: the rules to count.
            path: JSON file; empty: the counters are not saved.
        """
        super().__init__(rule_set)
        self._rule_set, self._path = rule_set, path
        # Suffix that the existing file is to be renamed with: the rule set that it counts, or
        # that it is damaged; empty to replace it.
        self._other = self.problem = ''
        self.until_ns = 0
        self.resumed = bool(path) and self._read()
        self._is_first = self._is_kept = self.resumed

    def add_stamped(self, judgement: Judgement, stamp_ns: int) -> None:
        """Count the samples of one judgement, unless the previous process has.

        A simulation repeats its last samples after a restart, which may be in the file already.
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
        """Write the file atomically, unless it is up to date.

        Raises:
            OccError: it cannot be written; the previous file stays.
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
        if self._other:
            try:
                target = Path(os.path.realpath(self._path))
                if target.is_file():
                    target.replace(_free_name(f'{self._path}.{self._other}'))
            except OSError as error:
                raise OccError(f'cannot write {self._path}: {error.strerror or error}') from error
        self._other = ''
        # Not synced to disk: a monitor writes this every second while it judges.
        with replacing(self._path, COUNTS, durable=False) as draft:
            draft.write_text(json.dumps(document, indent=1), encoding='utf-8')
        self._is_kept = True

    def _read(self) -> bool:
        """Load the file; return whether it counts these rules."""
        try:
            if not _may_exist(self._path):
                return False
            text = read_bytes(self._path, _MOST_BYTES)
            document: Any = json.loads(text)
            if document['format'] != _FORMAT:
                raise ValueError(document['format'])
            if document['rule_set'] != self._rule_set.fingerprint:
                self._other = _name_of(document['rule_set'])
                return False
            counts = [document['rules'][rule.id] for rule in self._rule_set.rules]
            evaluated = np.array([_count(item['evaluated']) for item in counts], np.int64)
            violated = np.array([_count(item['violated']) for item in counts], np.int64)
            self.until_ns = int(document['until_ns'])
        except OccError as error:
            self.problem = str(error)
        except (ValueError, KeyError, TypeError, OverflowError, RecursionError):
            self.problem = f'{self._path} is not a file of rule counters; allowed is {_FORMAT!r}'
        else:
            self.evaluated[:], self.violated[:] = evaluated, violated
            return True
        self._other = _DAMAGED
        return False


def _may_exist(path: str | Path) -> bool:
    try:
        os.lstat(path)
    except FileNotFoundError:
        return False
    except OSError:
        # What is wrong shows when it is read.
        return True
    return True


def _count(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise ValueError(value)
    return value


def _name_of(fingerprint: Any) -> str:
    """Return the fingerprint of a rule set for use in a file name.

    Raises:
        ValueError: it is not a fingerprint.
    """
    if not isinstance(fingerprint, str) or not re.fullmatch(r'\w{1,64}', fingerprint):
        raise ValueError(fingerprint)
    return fingerprint


def _free_name(name: str) -> str:
    """Return a name that replaces nothing but older counters of the same rule set."""
    if not name.endswith(f'.{_DAMAGED}'):
        return name
    numbered = (f'{name}.{number}' for number in itertools.count(1))
    return next(path for path in itertools.chain([name], numbered) if not os.path.exists(path))


def read_counts(path: str | Path, rule_set: RuleSet) -> RuleCounts:
    """Return the counters of these rules that a file holds.

    Raises:
        DataError: it cannot be read, is no file of counters, or counts other rules.
    """
    if not os.path.exists(path):
        raise DataError(f'cannot read {path}: there is no such file')
    counts = PersistentCounts(rule_set, path)
    if counts.problem:
        raise DataError(counts.problem)
    if not counts.resumed:
        raise DataError(
            f'{path} counts other rules; allowed are counters of the rule set '
            f'{rule_set.fingerprint}, as a monitor writes them to its counts_file'
        )
    return counts
