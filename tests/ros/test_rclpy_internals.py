# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""What rclpy keeps private is used in one module, and no attribute of ours hides one of rclpy's."""

import ast
from pathlib import Path

import pytest

import occ_constraints_pkg

rclpy = pytest.importorskip('rclpy', reason="needs the extra 'ros'")

PACKAGE = Path(occ_constraints_pkg.__file__).parent
RCLPY = Path(rclpy.__file__).parent


# Classes of ours and of rclpy from which those derive that have rclpy's attributes.
BASES = {'Node', 'ParameterNode', 'OccNode', 'ManagedNode', 'LifecycleNodeMixin', 'Logger'}


def parsed(path):
    return ast.parse(path.read_text(encoding='utf-8'))


def private_attributes(tree):
    """Return the attributes with one underscore that are used, with what they are used on."""
    return {
        (ast.unparse(node.value), node.attr)
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute)
        and node.attr.startswith('_')
        and not node.attr.startswith('__')
    }


def test_only_one_module_uses_what_rclpy_keeps_private():
    of_rclpy = {
        name
        for module in ('node.py', 'lifecycle/node.py', 'impl/rcutils_logger.py')
        for owner, name in private_attributes(parsed(RCLPY / module))
        if owner in ('self', 'cls')
    }
    assert {'_parameter_overrides', '_state_machine'} <= of_rclpy
    for folder in ('ros', 'nodes'):
        for path in (PACKAGE / folder).rglob('*.py'):
            if path.name == 'rclpy_internals.py':
                continue
            for owner, name in private_attributes(parsed(path)):
                assert owner in ('self', 'cls'), f'{path} uses {owner}.{name}'
            for item in ast.walk(parsed(path)):
                if isinstance(item, ast.ClassDef) and BASES & set(map(ast.unparse, item.bases)):
                    taken = {name for _, name in private_attributes(item)} & of_rclpy
                    assert not taken, f'{item.name} in {path} uses {taken} of rclpy'
