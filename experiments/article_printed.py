# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Precision and recall as printed in the OC-tree article, and our results beside them.

Source: Itani, Lecron, Fortemps, Applied Soft Computing 91:106250 (2020), tables 6 to 8.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from experiments.results import markdown_table

NOISE_LEVELS = (2, 5, 10, 15)
METHODS = {'oc_tree': 'OC-tree', 'ocsvm': 'OCSVM', 'isolation_forest': 'Isolation Forest'}

# Per method, (precision, recall) at each of NOISE_LEVELS. Approach A, the article's table 6.
_PRINTED_A = {
    'Pima': {
        'oc_tree': [(0.992, 0.965), (0.992, 0.911), (0.980, 0.952), (0.992, 0.945)],
        'ocsvm': [(1.000, 0.941), (0.988, 0.957), (0.975, 0.933), (0.974, 0.901)],
        'isolation_forest': [(1.000, 0.874), (0.996, 0.914), (0.996, 0.952), (0.965, 0.988)],
    },
    'Ionosphere': {
        'oc_tree': [(1.000, 1.000), (1.000, 1.000), (0.983, 1.000), (0.982, 1.000)],
        'ocsvm': [(0.972, 0.897), (0.937, 0.904), (0.880, 0.904), (0.824, 0.920)],
        'isolation_forest': [(0.981, 0.879), (0.937, 0.904), (0.904, 0.912), (0.832, 0.929)],
    },
    'Iris': {
        'oc_tree': [(1.000, 0.941), (0.943, 1.000), (0.978, 0.900), (0.862, 1.000)],
        'ocsvm': [(1.000, 0.961), (0.980, 0.960), (1.000, 0.940), (0.889, 0.960)],
        'isolation_forest': [(1.000, 0.922), (0.978, 0.900), (0.958, 0.920), (0.889, 0.960)],
    },
    'Satimage': {
        'oc_tree': [(0.996, 0.968), (0.979, 0.981), (0.981, 0.969), (0.980, 0.968)],
        'ocsvm': [(0.996, 0.957), (0.986, 0.971), (0.977, 0.946), (0.966, 0.937)],
        'isolation_forest': [(0.996, 0.890), (0.984, 0.914), (0.952, 0.922), (0.907, 0.934)],
    },
}

# Approach B, the OC-tree's column of tables 7 and 8, per target class. The precision 0.865 of
# Satimage 5 at 15 % is printed with a recall of "9.980".
_PRINTED_B = {
    'Pima -1': [(0.976, 0.910), (0.952, 0.878), (0.926, 0.956), (0.862, 0.910)],
    'Pima +1': [(0.982, 0.988), (0.942, 0.982), (0.881, 0.975), (0.856, 0.963)],
    'Ionosphere -1': [(0.977, 1.000), (0.955, 1.000), (0.943, 0.805), (0.905, 0.884)],
    'Ionosphere +1': [(0.986, 0.973), (0.947, 0.959), (0.973, 0.973), (0.861, 0.944)],
    'Iris 1': [(1.000, 0.882), (1.000, 0.882), (1.000, 0.889), (1.000, 0.895)],
    'Iris 2': [(1.000, 1.000), (0.944, 1.000), (1.000, 1.000), (0.947, 0.947)],
    'Iris 3': [(1.000, 1.000), (0.938, 0.882), (1.000, 0.833), (1.000, 0.895)],
    'Satimage 1': [(0.997, 0.958), (0.983, 0.972), (0.970, 0.992), (0.918, 0.992)],
    'Satimage 2': [(0.979, 0.910), (0.980, 0.955), (0.937, 0.968), (0.884, 0.981)],
    'Satimage 3': [(0.987, 0.959), (0.966, 0.975), (0.972, 0.948), (0.924, 0.971)],
    'Satimage 4': [(0.984, 0.933), (0.964, 0.985), (0.917, 0.985), (0.905, 0.993)],
    'Satimage 5': [(0.966, 0.941), (0.931, 0.974), (0.921, 0.968), (0.865, 0.980)],
    'Satimage 6': [(0.994, 0.986), (0.980, 0.991), (0.961, 0.980), (0.966, 0.957)],
}


def printed(target: str, method: str, noise: int) -> tuple[float, float] | None:
    """Return the article's (precision, recall), or ``None`` where this copy has none.

    Args:
        target: a data set such as ``Iris`` (approach A) or one with a class, ``Iris 2`` (B).
        method: one of :data:`METHODS`.
        noise: one of :data:`NOISE_LEVELS`.
    """
    if target in _PRINTED_A:
        return _PRINTED_A[target][method][NOISE_LEVELS.index(noise)]
    if method == 'oc_tree' and target in _PRINTED_B:
        return _PRINTED_B[target][NOISE_LEVELS.index(noise)]
    return None


def markdown(cells: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the cells as one Markdown table per approach, precision / recall in each place.

    Args:
        cells: the ``cells`` of the results, keyed by target and noise level.
    """
    parts = []
    for approach, title in (('A', 'all data are target'), ('B', 'one class is target')):
        chosen = [cell for cell in cells.values() if cell['approach'] == approach]
        if not chosen:
            continue
        heads = [text for name in METHODS.values() for text in (name, 'printed')]
        if approach == 'B':
            heads = [METHODS['oc_tree'], 'printed', *list(METHODS.values())[1:]]
        table = markdown_table(
            ('data', 'x %', *heads), [_entries(cell, approach) for cell in chosen]
        )
        parts.append(f'Approach {approach}: {title}\n\n{table}')
    return '\n\n'.join(parts) + '\n'


def _entries(cell: Mapping[str, Any], approach: str) -> list[str]:
    entries = [cell['target'], str(cell['noise_percent'])]
    for method in METHODS:
        result = cell['methods'][method]
        entries.append(' / '.join(_spread(result[measure]) for measure in ('precision', 'recall')))
        if approach == 'A' or method == 'oc_tree':
            values = printed(cell['target'], method, cell['noise_percent'])
            entries.append(' / '.join(_short(value) for value in values) if values else '-')
    return entries


def _spread(value: Mapping[str, float]) -> str:
    return f'{_short(value["mean"])} ± {_short(value["std"])}'


def _short(value: float) -> str:
    return f'{value:.3f}'.removeprefix('0')
