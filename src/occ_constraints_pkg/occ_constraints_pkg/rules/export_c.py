# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""A rule set as one self-contained C99 header, which judges as :meth:`RuleSet.judge` does."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable

import numpy as np

from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.rules.ruleset import RuleSet

_HEADER = """\
/* Safety rules learned from demonstrations, rule set {fingerprint}.
 * Written by `occ export c`; write it anew instead of editing it.
 *
 *     double features[{upper}_FEATURES] = {{...}};
 *     {prefix}_judgement now = {prefix}_judge(features);
 *
 * C99 and IEEE doubles; no allocation, no state, no dependency but <math.h>'s macros.
 * Do not compile it with -ffast-math, which gives up NaN.
 * Worst case of one call: {comparisons} comparisons of doubles.
 */
#ifndef {upper}_RULES_H
#define {upper}_RULES_H

#include <float.h>
#include <math.h>

#if defined(__FAST_MATH__) || (defined(FLT_EVAL_METHOD) && FLT_EVAL_METHOD != 0)
#error "these rules need IEEE doubles: no -ffast-math, and no x87 arithmetic"
#endif

#define {upper}_RULE_SET "{fingerprint}"
#define {upper}_FEATURES {features}
#define {upper}_RULES {rules}

typedef enum {{ {upper}_SAFE = 0, {upper}_VIOLATED = 1, {upper}_UNKNOWN = 2 }} {prefix}_verdict;

typedef struct {{
  {prefix}_verdict verdict; /* treat UNKNOWN as unsafe */
  int rule;       /* first violated rule, for the tables below; -1 for none */
  double margin;  /* signed distance to the boundary, > 0 inside; NaN if UNKNOWN */
}} {prefix}_judgement;

/* Features in this order, with their units and physical bounds; a value outside is UNKNOWN. */
static const char *const {prefix}_feature_names[] = {{{names}}};
static const char *const {prefix}_feature_units[] = {{{units}}};
static const double {prefix}_lows[] = {{{lows}}};
static const double {prefix}_highs[] = {{{highs}}};

/* Rules in the order of the constraints file; disabled ones are named but never tried. */
static const char *const {prefix}_rule_ids[] = {{{ids}}};
static const char *const {prefix}_rule_texts[] = {{{texts}}};

/* Enabled rules in the order they are tried, and where their literals begin; the last entry ends
 * the table of literals. A literal is true if sign * feature is above bound, or, unless it is
 * strict, equal to it. Of a family it speaks of any member, so of the largest sign * feature; the
 * features of each literal begin at the entry of members, and end where the next one's do. */
static const int {prefix}_order[] = {{{order}}};
static const int {prefix}_starts[] = {{{starts}}};
static const int {prefix}_members[] = {{{members}}};
static const int {prefix}_feature[] = {{{feature}}};
static const double {prefix}_sign[] = {{{sign}}};
static const double {prefix}_bound[] = {{{bound}}};
static const int {prefix}_strict[] = {{{strict}}};
static const double {prefix}_scale[] = {{{scale}}};

static inline {prefix}_judgement {prefix}_judge(const double features[{upper}_FEATURES]) {{
  {prefix}_judgement result = {{{upper}_SAFE, -1, INFINITY}};
  for (int i = 0; i < {upper}_FEATURES; ++i) {{
    /* Written so that NaN fails. */
    if (!(features[i] >= {prefix}_lows[i] && features[i] <= {prefix}_highs[i])) {{
      result.verdict = {upper}_UNKNOWN;
      result.margin = NAN;
      return result;
    }}
  }}
  for (int i = 0; i < {tried}; ++i) {{
    int is_true = 1;
    double margin = -INFINITY;
    for (int j = {prefix}_starts[i]; j < {prefix}_starts[i + 1]; ++j) {{
      double value = {prefix}_sign[j] * features[{prefix}_feature[{prefix}_members[j]]];
      for (int m = {prefix}_members[j] + 1; m < {prefix}_members[j + 1]; ++m) {{
        const double other = {prefix}_sign[j] * features[{prefix}_feature[m]];
        if (other > value) value = other;
      }}
      const double distance = ({prefix}_bound[j] - value) / {prefix}_scale[j];
      is_true &= {prefix}_strict[j] ? value > {prefix}_bound[j] : value >= {prefix}_bound[j];
      if (distance > margin) margin = distance;
    }}
    if (margin < result.margin) result.margin = margin;
    if (is_true && result.rule < 0) {{
      result.verdict = {upper}_VIOLATED;
      result.rule = {prefix}_order[i];
    }}
  }}
  return result;
}}

#endif
"""


def export_c(rule_set: RuleSet, prefix: str = 'occ') -> str:
    """Return C99 source with a function ``PREFIX_judge``.

    It gives the verdict, the position of the first violated rule and the margin that
    :meth:`RuleSet.judge` gives for the same doubles; numbers are written in hexadecimal, so none
    is rounded.

    Args:
        rule_set: the rules; disabled ones are named in the tables but never evaluated.
        prefix: begins every name, so that several rule sets fit into one program.

    Raises:
        ConfigurationError: the prefix is no C identifier in lower case.
    """
    if not re.fullmatch(r'[a-z][a-z0-9_]*', prefix):
        raise ConfigurationError(
            f'prefix {prefix!r}: allowed are lower-case letters, digits and _, a letter first'
        )
    space, rules = rule_set.space, rule_set.rules
    tried = [rules[index].literals for index in rule_set.order]
    literals = [literal for conjunction in tried for literal in conjunction]
    signs = [literal.sign for literal in literals]
    members = [len(literal.members) for literal in literals]
    # An infinite bound becomes the largest double, so that infinite values are UNKNOWN as well.
    largest = np.finfo(np.float64).max
    return _HEADER.format(
        prefix=prefix,
        upper=prefix.upper(),
        fingerprint=rule_set.fingerprint,
        features=len(space),
        rules=len(rules),
        tried=len(tried),
        # Two per feature; of each literal its truth, its margin, and those between members of a
        # family; one margin per rule.
        comparisons=2 * len(space) + len(literals) + sum(members) + len(tried),
        names=_strings(space.names),
        units=_strings(feature.unit for feature in space.features),
        lows=_doubles(space.lows.clip(-largest)),
        highs=_doubles(space.highs.clip(max=largest)),
        ids=_strings(rule.id for rule in rules),
        texts=_strings(rule.words(space) for rule in rules),
        order=_integers(rule_set.order),
        starts=_integers(itertools.accumulate(map(len, tried), initial=0)),
        members=_integers(itertools.accumulate(members, initial=0)),
        feature=_integers(member for literal in literals for member in literal.members),
        sign=_doubles(signs),
        bound=_doubles(sign * literal.bound for sign, literal in zip(signs, literals, strict=True)),
        strict=_integers(literal.is_strict for literal in literals),
        scale=_doubles(rule_set.scale[literal.members[0]] for literal in literals),
    )


def _rows(items: Iterable[str]) -> str:
    # C has no empty arrays; an entry that nothing reads stands in.
    return '\n  ' + ',\n  '.join(list(items) or ['0']) + '\n'


def _strings(texts: Iterable[str]) -> str:
    return _rows(f'"{"".join(map(_character, text.encode()))}"' for text in texts)


def _character(byte: int) -> str:
    plain = 0x20 <= byte < 0x7F and chr(byte) not in '"\\?'
    return chr(byte) if plain else f'\\{byte:03o}'


def _doubles(numbers: Iterable[float]) -> str:
    return _rows(float(number).hex() for number in numbers)


def _integers(numbers: Iterable[int]) -> str:
    return _rows(str(int(number)) for number in numbers)
