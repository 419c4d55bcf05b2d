# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The OC-tree as a scikit-learn outlier detector; imports also where scikit-learn is absent."""

from __future__ import annotations

from dataclasses import replace
from numbers import Real
from typing import Any

import numpy as np

from occ_constraints_pkg.errors import OccError, import_needed
from occ_constraints_pkg.learning.conditional import ConditionalSettings
from occ_constraints_pkg.learning.conditional.settings import (
    chosen_conditions,
    resolved_conditions,
)
from occ_constraints_pkg.learning.learn import grow, learn_safe_set
from occ_constraints_pkg.learning.samples import divide_samples
from occ_constraints_pkg.learning.settings import OCTreeSettings
from occ_constraints_pkg.rules.rule import Rule
from occ_constraints_pkg.rules.ruleset import RuleSet
from occ_constraints_pkg.rules.space import Feature, FeatureSpace
from occ_constraints_pkg.rules.verdict import Verdict

try:
    from sklearn.base import BaseEstimator, OutlierMixin
    from sklearn.utils.validation import (
        check_consistent_length,
        check_is_fitted,
        column_or_1d,
        validate_data,
    )
except ModuleNotFoundError as error:
    if (error.name or '').partition('.')[0] != 'sklearn':
        raise

    class OutlierMixin:  # type: ignore[no-redef]
        """Stands in for scikit-learn's."""

    class BaseEstimator:  # type: ignore[no-redef]
        """Stands in for scikit-learn's; creating one raises an error that names what is missing."""

        def __new__(cls, *arguments: Any, **parameters: Any) -> BaseEstimator:
            """Raise MissingDependencyError."""
            return import_needed(cls.__name__, 'sklearn.base')


_LARGEST = np.finfo(np.float64).max


class OCTreeClassifier(OutlierMixin, BaseEstimator):
    """Interpretable outlier detector: a one-class tree, written as rules.

    With the defaults it learns a box around the samples, less the combinations of two or three
    features that they avoid (see ``conditions``). With ``alpha`` above 0 or ``clip='density'`` it
    learns the boxes that the samples fill, and whatever is in none of them is an outlier. A feature
    that was constant in training must stay constant. For physical bounds, families and a complete
    constraints file use :func:`occ_constraints_pkg.learning.learn.learn`.

    Args:
        contamination: ``'auto'`` for the rules as learned (as ``learn`` does for the same samples
            and settings), with ``most_outside`` as the share that clipping may leave outside. Or
            the share of outliers among the training samples, above 0 and up to 0.5: the tree clips
            by that share, and all bounds are then moved by one margin until that many samples are
            outside, as closely as samples with equal margins allow. The samples that bounds were
            learned from all have margin 0; no bound moves if the target falls among them.
        most_outside: for ``'auto'``: the ``contamination`` of :class:`OCTreeSettings`; ``None``
            to estimate it as ``occ learn`` does, which finds only distant outliers if there are no
            families of features. The default is a number because scikit-learn expects a detector
            to find outliers in any sample.
        conditions: ``'triples'`` or ``'pairs'`` to look for rules about up to three, or two,
            features as well, and to leave each bound at a training extreme a margin; ``'none'`` for
            the box alone. ``'auto'`` for triples, or none where the tree may branch.
        max_depth: this and the others: see :class:`OCTreeSettings`.
        clip: see there.
        gamma: see there.
        alpha: see there.
        beta: see there.
        min_split: see there.
        nu: see there.
        full_conditions: see there.

    Attributes:
        rule_set_: the rules; ``predict`` is -1 exactly where one of them is true.
        tree_: the root of the tree as learned, before any move of the bounds.
        offset_: the margin by which bounds were moved inward, outward if negative; 0.0 for
            ``'auto'``. ``decision_function`` is ``score_samples`` less this.
        n_features_in_: number of features seen by ``fit``.
        feature_names_in_: (n_features_in_,) names of the columns, if all were text. Else rules
            speak of x0, x1, ...

    See Also:
        ``sklearn.svm.OneClassSVM`` and ``sklearn.ensemble.IsolationForest``, which follow
        combinations of features, but whose decision cannot be written down.

    References:
        S. Itani, F. Lecron, P. Fortemps, "A one-class classification decision tree based on
        kernel density estimation", Applied Soft Computing 91:106250, 2020.

    Examples:
        >>> import numpy as np
        >>> from occ_constraints_pkg.learning.estimator import OCTreeClassifier
        >>> drives = np.random.default_rng(0).normal([1.0, 0.0], [0.2, 0.5], size=(1000, 2))
        >>> detector = OCTreeClassifier(max_depth=2).fit(drives)
        >>> detector.predict([[1.0, 0.0], [1.0, 1.5]])
        array([ 1, -1])
        >>> detector.decision_function([[1.0, 0.0], [1.0, 1.5]]).round(2)
        array([ 0.37, -0.06])
        >>> for rule in detector.rule_set_.rules:
        ...     print(rule.words(detector.rule_set_.space))
        x0 below 0.3771
        x0 above 1.576
        x1 below -1.256
        x1 above 1.3
    """

    def __init__(
        self,
        *,
        contamination: float | str = 'auto',
        most_outside: float | None = 0.01,
        conditions: str = 'auto',
        max_depth: int | None = 20,
        clip: str = 'mass',
        gamma: float = 0.05,
        alpha: float = 0.0,
        beta: float = 0.0001,
        min_split: float = 0.02,
        nu: float | None = None,
        full_conditions: bool = False,
    ) -> None:
        self.contamination = contamination
        self.most_outside = most_outside
        self.conditions = conditions
        self.max_depth = max_depth
        self.clip = clip
        self.gamma = gamma
        self.alpha = alpha
        self.beta = beta
        self.min_split = min_split
        self.nu = nu
        self.full_conditions = full_conditions

    def fit(self, X: Any, y: Any = None, groups: Any = None) -> OCTreeClassifier:
        """Learn from samples, most of which are inliers.

        Args:
            X: (n, k) array or data frame of finite numbers; those of a group in the order of time.
            y: ignored; here because scikit-learn's interface has it.
            groups: (n,) the episode of each sample, for samples of one depend on each other.
                ``None`` if all are independent; conditional rules of a time series without groups
                may be chance.

        Returns:
            The estimator itself.

        Raises:
            ValueError: a parameter or a sample is not allowed.
        """
        settings, conditional = self._settings()
        rows = validate_data(self, X, dtype=np.float64)
        names = getattr(self, 'feature_names_in_', [f'x{index}' for index in range(rows.shape[1])])
        episodes = np.arange(len(rows))
        if groups is not None:
            check_consistent_length(rows, groups)
            episodes = np.unique(column_or_1d(groups), return_inverse=True)[1]
        try:
            space = FeatureSpace(tuple(Feature(str(name)) for name in names))
            samples = divide_samples(
                rows, episodes, space, rng=np.random.default_rng(0), held_out_share=0.0
            )
            tree = grow(rows, space, settings)
            learned = learn_safe_set(samples, space, settings, conditional, tree=tree)
        except OccError as error:
            raise ValueError(str(error)) from error
        rule_set = learned.formula.rule_set
        offset = 0.0
        if not isinstance(self.contamination, str):
            offset = _offset(_margins(rule_set, rows), self.contamination)
            rule_set = _moved(rule_set, offset)
        self.tree_, self.rule_set_, self.offset_ = tree, rule_set, offset
        return self

    def predict(self, X: Any) -> np.ndarray:
        """Return 1 for each inlier of (n, k) samples and -1 for each outlier: (n,) int64."""
        return np.where(self.decision_function(X) >= 0.0, 1, -1)

    def decision_function(self, X: Any) -> np.ndarray:
        """Return the margin of (n, k) samples: (n,) float64, at least 0 for inliers only.

        The margin of :meth:`RuleSet.judge`, except that a violation exactly on a bound, which has
        margin 0 there, gets the largest negative number: here the sign is the decision.

        Raises:
            ValueError: a value is not finite, or the samples are not of the features of ``fit``.
            TypeError: the samples are sparse.
        """
        check_is_fitted(self)
        return _margins(self.rule_set_, validate_data(self, X, dtype=np.float64, reset=False))

    def score_samples(self, X: Any) -> np.ndarray:
        """Return (n,) float64, larger is more normal: margins before the bounds were moved."""
        return self.decision_function(X) + self.offset_

    def _settings(self) -> tuple[OCTreeSettings, ConditionalSettings]:
        own = self.get_params()
        conditions = own.pop('conditions')
        share, outside = own.pop('contamination'), own.pop('most_outside')
        if outside is not None and not (isinstance(outside, Real) and 0.0 <= float(outside) < 1.0):
            raise ValueError(
                f'most_outside is {outside!r}; allowed are None and 0 <= most_outside < 1'
            )
        if isinstance(share, str):
            if share != 'auto':
                raise ValueError(f"contamination is {share!r}; allowed are 'auto' and a number")
            share = outside
        elif not (isinstance(share, Real) and 0.0 < float(share) <= 0.5):
            raise ValueError(f"contamination is {share!r}; allowed are 'auto' and over 0 to 0.5")
        try:
            settings = OCTreeSettings(contamination=share, **own)
            chosen = chosen_conditions(None if conditions == 'auto' else conditions, ())
            return settings, resolved_conditions(chosen, settings)
        except OccError as error:
            raise ValueError(str(error)) from error


def _margins(rule_set: RuleSet, rows: np.ndarray) -> np.ndarray:
    """Return (n,) finite margins, negative exactly where a rule is true."""
    judgement = rule_set.judge(rows)
    margin = judgement.margin.clip(-_LARGEST, _LARGEST)
    below = np.minimum(margin, -np.finfo(np.float64).smallest_subnormal)
    return np.where(judgement.verdict == Verdict.SAFE, margin, below)


def _offset(margins: np.ndarray, share: float) -> float:
    """Return a margin with a share of (n,) margins below it, and none close to it.

    As many as scikit-learn's detectors leave below their percentile of the scores. Equal margins
    stay together, inside; so do the samples that bounds were learned from, with margin 0, which
    rounding would separate if the bounds moved.
    """
    ordered = np.sort(margins)
    innermost = ordered[int(np.ceil(share * (len(ordered) - 1)))]
    below = ordered[ordered < innermost]
    if not len(below):
        return float(min(0.0, 2.0 * innermost))
    if below[-1] < 0.0 <= innermost:
        return 0.0
    # Halfway, so that rounding of the moved bounds does not matter.
    return float(below[-1] / 2.0 + innermost / 2.0)


def _moved(rule_set: RuleSet, offset: float) -> RuleSet:
    """Return the rules that are true where the margin to the given ones is below ``offset``."""
    rules: list[Rule] = []
    for rule in rule_set.rules:
        literals = []
        for literal in rule.literals:
            with np.errstate(over='ignore'):
                step = offset * rule_set.scale[literal.members[0]]
                bound = literal.bound + (step if literal.is_upper else -step)
            literals.append(replace(literal, bound=float(np.clip(bound, -_LARGEST, _LARGEST))))
        moved = replace(rule, literals=tuple(literals))
        # A gap narrower than twice the move outward closes.
        if not moved.is_contradictory:
            rules.append(moved)
    return replace(rule_set, rules=tuple(rules))
