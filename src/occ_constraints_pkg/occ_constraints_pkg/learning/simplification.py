# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Fewer and shorter rules that give every sample the same verdict."""

from __future__ import annotations

import itertools
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from occ_constraints_pkg.learning.boxes import Box, simplify_boxes
from occ_constraints_pkg.learning.extraction import extract_rules
from occ_constraints_pkg.learning.tree import Node
from occ_constraints_pkg.rules.rule import Literal, Rule, Subject
from occ_constraints_pkg.rules.ruleset import RuleSet, rule_ids
from occ_constraints_pkg.rules.space import FeatureSpace
from occ_constraints_pkg.terminal import printable
from occ_constraints_pkg.wording import count_of


@dataclass(frozen=True)
class Simplification:
    """The result of simplification.

    Attributes:
        rule_set: the simpler rules, in ascending number of literals.
        before: numbers of enabled rules and of their literals.
        after: the same of ``rule_set``.
        changed: for the id of each changed rule: the ids of the rules that it replaces.
        removed: ids of the rules that can never be true or that other rules contain.
        kept: ids of the enabled rules left unchanged because of their note or counters.
    """

    rule_set: RuleSet
    before: tuple[int, int]
    after: tuple[int, int]
    changed: Mapping[str, tuple[str, ...]]
    removed: tuple[str, ...]
    kept: tuple[str, ...]


def simplify(
    rule_set: RuleSet, *, renumber: bool = False, counted_too: bool = False
) -> Simplification:
    """Return rules that are true on exactly the same samples, but fewer and with fewer literals.

    Each rule is a box, exact to the float: ``x > 1`` begins at the next float after 1. These steps
    are repeated; none changes the union of the boxes within the physical bounds:

    - a literal is dropped that another one of the rule implies, or that holds for every possible
      value;
    - a rule is removed that can never be true, or that another rule contains;
    - rules that differ in one feature only, and there touch or overlap, become one;
    - rules that are equal but for the member of a family, one for each of its members, become one
      about any of them;
    - a literal is dropped if everything that the rule thereby gains lies in another rule.

    Verdicts stay the same, and so do margins of safe samples, except that rules beyond the physical
    bounds no longer count. On violations the margin gets closer to the true distance, from below in
    absolute value. This holds for the rule set as a whole: disabling a rule later can have a larger
    effect than before.

    Disabled rules, rules with a note and rules with counters are neither changed nor removed
    (enabled ones still make others redundant). An unchanged rule keeps its id, and so does one
    whose id is not derived from its literals.

    Time is quadratic in the number of literals of rules on several features; thousands are fine.

    Args:
        rule_set: learned, edited, or written by hand.
        renumber: assign all ids anew, as for rules that nobody has seen yet.
        counted_too: also simplify rules with counters; those that change start at 0.
    """
    before = rule_set.rules
    stay = [
        not rule.enabled or bool(rule.note) or (rule.evaluated > 0 and not counted_too)
        for rule in before
    ]
    boxes = [
        Box.of(rule, index, fixed=stay[index]) for index, rule in enumerate(before) if rule.enabled
    ]
    # Without any rule everything would be UNKNOWN, so one stays, though it can never be true.
    simple = simplify_boxes(rule_set.space, boxes) or boxes[:1]
    rules = _rebuilt(rule_set, simple, stay)
    if renumber:
        ids = rule_ids(rule_set.space, [rule.literals for rule, _ in rules])
        rules = [
            (replace(rule, id=name), sources)
            for name, (rule, sources) in zip(ids, rules, strict=True)
        ]
    present = {index for _, sources in rules for index in sources}
    simpler = replace(rule_set, rules=tuple(rule for rule, _ in rules))
    return Simplification(
        simpler,
        size(rule_set),
        size(simpler),
        {
            rule.id: tuple(before[index].id for index in sources)
            for rule, sources in rules
            if len(sources) > 1 or rule.literals != before[sources[0]].literals
        },
        tuple(rule.id for index, rule in enumerate(before) if index not in present),
        tuple(rule.id for rule, stays in zip(before, stay, strict=True) if rule.enabled and stays),
    )


def extract_and_simplify(
    root: Node, space: FeatureSpace, demonstrated: np.ndarray, *, full_conditions: bool = False
) -> Simplification:
    """Return the complement of the tree's leaves in few and short rules.

    Args:
        root: the tree.
        space: the features, with their physical bounds.
        demonstrated: (k, 2) smallest and largest demonstrated values.
        full_conditions: return the rules with all bounds of every branch, as the paper prints
            them. ``before`` counts these in any case.
    """
    whole = extract_rules(root, space, demonstrated, full_conditions=True)
    if full_conditions:
        return Simplification(whole, size(whole), size(whole), {}, (), ())
    needed = extract_rules(root, space, demonstrated)
    return replace(simplify(needed, renumber=True), before=size(whole))


def size(rule_set: RuleSet) -> tuple[int, int]:
    """Return the numbers of enabled rules and of their literals."""
    lengths = [len(rule.literals) for rule in rule_set.rules if rule.enabled]
    return len(lengths), sum(lengths)


def _rebuilt(
    rule_set: RuleSet, boxes: list[Box], stay: Sequence[bool]
) -> list[tuple[Rule, list[int]]]:
    """Return the rules with the positions of those they replace, shortest first."""
    free = {box.sources[0]: box for box in boxes if not box.fixed}
    rules, changed = [], []
    for index, rule in enumerate(rule_set.rules):
        if stay[index]:
            rules.append((rule, [index]))
        elif index in free:
            box = free[index]
            literals = _in_order(box, rule)
            if len(literals) == len(rule.literals) and set(literals) == set(rule.literals):
                rules.append((rule, box.sources))
            else:
                changed.append(len(rules))
                rules.append(
                    (replace(rule, literals=literals, evaluated=0, violated=0), box.sources)
                )
    taken = {rule.id for place, (rule, _) in enumerate(rules) if place not in set(changed)}
    for place in changed:
        rule, sources = rules[place]
        name = _new_id(rule_set.space, rule_set.rules[sources[0]], rule.literals, taken)
        taken.add(name)
        rules[place] = replace(rule, id=name), sources
    return sorted(rules, key=lambda item: len(item[0].literals))


def _in_order(box: Box, rule: Rule) -> tuple[Literal, ...]:
    """Return the box's literals with the features in the order of its first rule."""
    order = [literal.members for literal in rule.literals]

    def place(end: tuple[Subject, bool]) -> tuple[int, bool]:
        members = set(end[0][0])
        return next(index for index, own in enumerate(order) if members & set(own)), end[1]

    return tuple(box.ends[end] for end in sorted(box.ends, key=place)) or rule.literals[:1]


def _new_id(
    space: FeatureSpace, rule: Rule, literals: tuple[Literal, ...], taken: Container[str]
) -> str:
    """Return the id of a changed rule: a name given by a person stays, a digest is renewed."""
    own, new = rule_ids(space, [rule.literals])[0], rule_ids(space, [literals])[0]
    base = new if rule.id.partition('-')[0] == own else rule.id
    names = (base if number == 1 else f'{base}-{number}' for number in itertools.count(1))
    return next(name for name in names if name not in taken)


def describe_simplification(result: Simplification) -> str:
    """Return which rules were merged, removed and kept, and the numbers before and after."""
    lines = [f'{name} stands for {", ".join(former)}' for name, former in result.changed.items()]
    if result.removed:
        lines.append(f'needed no more: {", ".join(result.removed)}')
    if result.kept:
        lines.append(f'left alone for their note or counters: {", ".join(result.kept)}')
    rules, literals = result.before
    lines.append(
        f'{count_of(rules, "rule")} with {count_of(literals, "literal")} before, '
        + '{} with {} after'.format(*result.after)
    )
    return '\n'.join(map(printable, lines))


def simplification_document(result: Simplification) -> dict[str, Any]:
    """Return the same as plain values, ready for JSON."""
    return {
        **dict(zip(('rules_before', 'literals_before'), result.before, strict=True)),
        **dict(zip(('rules', 'literals'), result.after, strict=True)),
        'changed': {name: list(former) for name, former in result.changed.items()},
        'removed': list(result.removed),
        'kept': list(result.kept),
    }
