# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Learning as a whole: samples in, a constraints file's content out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

import occ_constraints_pkg
from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.learning.calibration import (
    Movable,
    SafeSet,
    calibrate,
    episodes_needed,
    least_false_alarm,
    space_limits,
)
from occ_constraints_pkg.learning.conditional import ConditionalSettings
from occ_constraints_pkg.learning.conditional.forest import SafeForest
from occ_constraints_pkg.learning.conditional.formula import learn_rules, write_formula
from occ_constraints_pkg.learning.conditional.moving import MovableRules
from occ_constraints_pkg.learning.conditional.rules import ConditionalRule
from occ_constraints_pkg.learning.conditional.settings import resolved_conditions
from occ_constraints_pkg.learning.evidence import (
    MOST_LITERALS,
    evidence_document,
    gather_evidence,
)
from occ_constraints_pkg.learning.safe_set import fit_safe_set
from occ_constraints_pkg.learning.samples import (
    LEAST_EPISODES_TO_HOLD_OUT,
    Samples,
    divide_samples,
    families,
)
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.learning.simplification import Simplification, extract_and_simplify
from occ_constraints_pkg.learning.tree import Node
from occ_constraints_pkg.rules.constraints_file import Constraints
from occ_constraints_pkg.rules.ruleset import RuleSet
from occ_constraints_pkg.rules.space import FeatureSpace
from occ_constraints_pkg.rules.verdict import Verdict
from occ_constraints_pkg.wording import count_of


def learn(
    values: np.ndarray,
    episodes: np.ndarray,
    space: FeatureSpace,
    settings: OCTreeSettings | None = None,
    *,
    rng: np.random.Generator,
    conditional: ConditionalSettings | None = None,
    independent: np.ndarray | None = None,
    held_out_share: float = 0.2,
    false_alarm: float | None = None,
    safe_episodes: tuple[np.ndarray, np.ndarray] | None = None,
    feature_map: Mapping[str, Any] | None = None,
    bags: Sequence[Mapping[str, Any]] = (),
    origin: Callable[[int], Mapping[str, int]] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Constraints:
    """Learn constraints from demonstrations.

    Samples with a value that is not finite or outside its physical bounds are left out, because
    they would be UNKNOWN at run time. A share of the episodes is held out to measure the coverage
    on unseen ones.

    Args:
        values: (n, k) samples.
        episodes: (n,) the episode each sample belongs to.
        space: the features.
        settings: the tree learner's parameters; ``None`` for the defaults.
        rng: chooses the held-out episodes.
        conditional: which rules with several literals to look for as well; samples of an episode
            are then in the order of time. ``None`` for the default, see
            :func:`~occ_constraints_pkg.learning.conditional.settings.resolved_conditions`.
        independent: (n,) what evidence for conditional rules is counted by, where that is not the
            episode: a label for each sample, the same for episodes that depend on each other.
        held_out_share: share of episodes to hold out when there are five or more.
        false_alarm: largest probability that a fresh safe episode has a violation; bounds are
            moved outward for that, see :mod:`~occ_constraints_pkg.learning.calibration`. ``None``
            guarantees nothing and moves nothing.
        safe_episodes: (m, k) samples and their (m,) episodes to calibrate on. ``None`` for the
            held-out episodes, as many as needed, up to half of all.
        feature_map: document of the feature map, kept in the file. What it keeps apart is not
            combined.
        bags: name, sha256 and messages of each recording, kept in the file.
        origin: maps a position in ``values`` to the source of that sample, for the evidence;
            ``source`` is a position in ``bags``.
        progress: called with (level, leaves so far) after each level of the tree.

    Raises:
        DataError: there is no usable sample, or the share is not within 0 to 1.
        ConfigurationError: there are too few episodes for the stated probability, or settings
            that do not go together.
    """
    settings = settings if settings is not None else OCTreeSettings()
    conditional = resolved_conditions(conditional, settings)
    if feature_map is not None:
        pairs = [(one, other) for one, other in feature_map.get('apart', ())]
        conditional = conditional.keeping_apart(pairs)
    needed = 0 if false_alarm is None or safe_episodes is not None else episodes_needed(false_alarm)
    samples = divide_samples(
        values,
        episodes,
        space,
        rng=rng,
        held_out_share=held_out_share,
        hold_out_least=needed,
    )
    if false_alarm is not None and safe_episodes is None:
        _check_enough(false_alarm, needed, samples)
        safe_episodes = samples.held_out, samples.held_out_names
    training = samples.training
    labels = None if independent is None else independent[samples.positions]
    found = learn_safe_set(
        samples, space, settings, conditional, independent=labels, progress=progress
    )
    calibration: dict[str, Any] = {}
    if false_alarm is not None and safe_episodes is not None:
        found, calibration = _calibrated(found, space, safe_episodes, false_alarm)
    formula = found.formula
    rule_set = formula.rule_set
    safe = is_safe(rule_set, training)
    held_out = samples.held_out
    held_out_safe = is_safe(rule_set, held_out)
    coverage = {
        'training_samples': len(training),
        'training': float(np.mean(safe)),
        'held_out_episodes': samples.held_out_episodes,
        'held_out_samples': len(held_out),
        'held_out': float(np.mean(held_out_safe)) if len(held_out) else None,
        # An unusable sample is UNKNOWN, which costs the same as a violation.
        'cost_per_episode': int((~safe).sum() + (~held_out_safe).sum() + samples.unusable)
        / len(np.unique(episodes)),
    }
    evidence = {}
    if formula.after[1] <= MOST_LITERALS:
        evidence = evidence_document(
            gather_evidence(rule_set, training, safe, samples.episodes, families(space, settings)),
            space,
            lambda row: {} if origin is None else origin(samples.positions[row]),
            found.origins,
        )
    provenance = {
        'created': datetime.now(UTC).isoformat(timespec='seconds'),
        'package_version': occ_constraints_pkg.__version__,
        'learned_formula': rule_set.fingerprint,
        'bags': [dict(bag) for bag in bags],
    }
    return Constraints(
        rule_set,
        feature_map,
        tree_document(found.tree, space),
        {
            **asdict(settings),
            'unusable_samples': samples.unusable,
            'extracted_rules': formula.before[0],
            'extracted_literals': formula.before[1],
            **({'calibration': calibration} if calibration else {}),
            **({'conditional': conditional.document()} if conditional.looks else {}),
        },
        coverage,
        provenance,
        evidence,
        found.safe_set,
    )


@dataclass(frozen=True, eq=False)
class Learned:
    """What was learned, and how it is written once its bounds were moved.

    Attributes:
        tree: the one-class tree, or the box of conditional rules as one.
        formula: the rules.
        movable: the safe set.
        write: returns the same for a safe set with moved bounds.
        origins: by its id, the conditional rule that a rule stands for.
        safe_set: the safe set of conditional rules as plain values, empty for a tree.
    """

    tree: Node
    formula: Simplification
    movable: Movable
    write: Callable[[Any], Learned]
    origins: Mapping[str, ConditionalRule] = field(default_factory=dict)
    safe_set: Mapping[str, Any] = field(default_factory=dict)


def learn_safe_set(
    samples: Samples,
    space: FeatureSpace,
    settings: OCTreeSettings,
    conditional: ConditionalSettings,
    *,
    tree: Node | None = None,
    independent: np.ndarray | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Learned:
    """Learn the safe set and its rules from the training samples.

    Args:
        samples: usable samples.
        space: the features.
        settings: of the tree learner.
        conditional: which conditional rules to look for; only within a tree that is one box.
        tree: the one-class tree if it was grown already.
        independent: (n,) what evidence for conditional rules is counted by; ``None`` for episodes.
        progress: called with (level, leaves so far) after each level of the tree.
    """
    training = samples.training
    demonstrated = samples.demonstrated(space, settings)
    if tree is None:
        tree = grow(training, space, settings, progress=progress)
    scale, limits = RuleSet(space, (), demonstrated).scale, space_limits(space)

    def write_tree(found: SafeSet) -> Learned:
        formula = extract_and_simplify(
            found.tree, space, found.box, full_conditions=settings.full_conditions
        )
        # The demonstrated range, the unit of the margin, does not change.
        rule_set = replace(formula.rule_set, demonstrated=demonstrated)
        return Learned(found.tree, replace(formula, rule_set=rule_set), found, write_tree)

    def write_rules(found: MovableRules) -> Learned:
        written = write_formula(found.learned, tree, training, space, demonstrated)
        return Learned(
            written.tree,
            written.formula,
            found,
            write_rules,
            written.origins,
            SafeForest.of(found.learned).document(space),
        )

    if not conditional.looks:
        return write_tree(SafeSet(tree, demonstrated, scale, limits))
    learned = learn_rules(
        tree,
        training,
        samples.episodes,
        space,
        demonstrated,
        conditional,
        independent,
        # Of a stated share of bad samples, few beyond a bound are no reason to take it back.
        cuts_stay=bool(settings.contamination),
    )
    return write_rules(MovableRules(learned, scale, limits))


def _check_enough(false_alarm: float, needed: int, samples: Samples) -> None:
    """Refuse too few held-out episodes, in terms of the episodes that the user gave."""
    held_out = samples.held_out_episodes
    if held_out >= needed:
        return
    given = held_out + len(np.unique(samples.episodes))
    least = least_false_alarm(held_out)
    raise ConfigurationError(
        f'false_alarm {false_alarm:g} needs {count_of(needed, "safe episode")} to calibrate on, '
        + 'but of '
        + ('the 1 episode' if given == 1 else f'the {given} episodes')
        + f' given {held_out or "none"} can be held out for that; allowed are '
        f'{max(2 * needed, LEAST_EPISODES_TO_HOLD_OUT)} or more, or {count_of(needed, "other")} '
        'to calibrate on' + (f', or a false_alarm of {least} or more' if held_out else '')
    )


def _calibrated(
    found: Learned,
    space: FeatureSpace,
    safe_episodes: tuple[np.ndarray, np.ndarray],
    false_alarm: float,
) -> tuple[Learned, dict[str, Any]]:
    """Return what was learned with its bounds moved outward, and the guarantee."""
    rows, episodes = space.check_rows(safe_episodes[0]), np.asarray(safe_episodes[1])
    usable = space.knows(rows)
    moved, calibration = calibrate(found.movable, rows[usable], episodes[usable], false_alarm)
    before = found.formula.rule_set.rules
    if calibration.margin:
        found = found.write(moved)
    left = {rule.id for rule in found.formula.rule_set.rules}
    dropped = tuple(f'{rule.id}: {rule.words(space)}' for rule in before if rule.id not in left)
    return found, replace(calibration, vanished=dropped).document()


def tree_document(node: Node, space: FeatureSpace) -> dict[str, Any]:
    """Return the tree as nested plain values; a leaf is empty."""
    if node.feature is None:
        return {}
    branches = []
    for branch in node.branches:
        item = {'from': branch.low, 'to': branch.high, 'samples': branch.samples}
        below = tree_document(branch.node, space)
        branches.append({**item, 'below': below} if below else item)
    return {'split': space.names[node.feature], 'branches': branches}


def grow(
    training: np.ndarray,
    space: FeatureSpace,
    settings: OCTreeSettings,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> Node:
    """Return the tree learned from (n, k) usable samples of a feature space."""
    limits = space_limits(space)
    return fit_safe_set(
        training, settings, families=space.families, limits=limits, progress=progress
    )


def is_safe(rule_set: RuleSet, rows: np.ndarray) -> np.ndarray:
    """Tell for each of (n, k) samples whether its verdict is SAFE: (n,) bool."""
    return rule_set.verdicts(rows) == Verdict.SAFE
