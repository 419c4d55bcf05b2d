# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Pages in a browser, and recordings to show in them."""

import numpy as np
import pytest
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet


@pytest.fixture
def open_page(browser, tmp_path):
    """Return a function that opens a page from a file; messages of the console fail the test."""
    contexts, said = [], []

    def open_one(page, **options):
        path = tmp_path / f'page_{len(contexts)}.html'
        path.write_text(page if isinstance(page, str) else page.html(), encoding='utf-8')
        context = browser.new_context(**options)
        contexts.append(context)
        tab = context.new_page()
        tab.on('console', lambda message: said.append(message.text))
        tab.on('pageerror', lambda error: said.append(str(error)))
        tab.on('dialog', lambda dialog: (said.append(dialog.message), dialog.dismiss()))
        tab.on('request', lambda request: _check_is_local(request.url, said))
        tab.goto(f'file://{path}')
        return tab

    yield open_one
    for context in contexts:
        context.close()
    assert said == []


def _check_is_local(address, said):
    if not address.startswith(('file:', 'data:')):
        said.append(address)


@pytest.fixture
def space():
    """Return features of which two are a family."""
    return FeatureSpace(
        (
            Feature('speed', 'm/s', low=-10.0, high=10.0),
            Feature('d_0', 'm', family='d'),
            Feature('d_1', 'm', family='d'),
        )
    )


@pytest.fixture
def rule_set(space):
    """Return three enabled rules and one that is not."""
    rules = (
        Rule('fast', (Literal(0, '>', 1.0),)),
        Rule('near', (Literal((1, 2), '<', 0.3),)),
        Rule('fast-near', (Literal(0, '>', 0.5), Literal((1, 2), '<', 0.8))),
        Rule('backwards', (Literal(0, '<', -0.5),), enabled=False),
    )
    return RuleSet(space, rules, np.array([[0.0, 1.0], [0.3, 4.0], [0.3, 4.0]]))
