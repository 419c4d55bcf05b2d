# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The page of fifty recordings of an hour each with five hundred violations, in a browser."""

from __future__ import annotations

import shutil
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from occ_constraints_pkg.checking.timeline import Timeline, check_data
from occ_constraints_pkg.datasets.dataset import Dataset
from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.report.page import Page, write_page
from occ_constraints_pkg.report.recordings import add_recordings, summarize
from occ_constraints_pkg.report.rules import add_rules
from occ_constraints_pkg.rules import Feature, FeatureSpace, Literal, Rule, RuleSet
from occ_constraints_pkg.rules.constraints_file import Constraints

_RECORDINGS, _SECONDS, _HZ = 50, 3600, 20
_VIOLATIONS = 500
_ROUNDS = 5
# When the page can be used: its program has run to its end.
_OPENED = '() => performance.getEntriesByType("navigation")[0].loadEventEnd'
# From a typed bound until the next frame that shows the answer could be drawn.
_ASK = """bound => new Promise(done => {
  const input = document.querySelector('[data-bound="0"]');
  const began = performance.now();
  input.value = bound;
  input.dispatchEvent(new Event('input'));
  document.body.getBoundingClientRect();
  done(performance.now() - began);
})"""


def run(seconds: float = 0.0) -> dict[str, Any]:
    """Write the page and open it in headless Chromium, several times; the median counts.

    Args:
        seconds: has no meaning here.
    """
    from playwright.sync_api import sync_playwright

    chromium = shutil.which('chromium') or shutil.which('chromium-browser')
    if chromium is None:
        raise ConfigurationError('this benchmark needs Chromium; allowed is apt-get install it')
    rule_set, timeline = _judged()
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        path = Path(folder, 'page.html')
        began = time.perf_counter()
        page = Page('Fifty recordings')
        summarize(page, timeline)
        add_recordings(page, timeline, rule_set)
        add_rules(page, Constraints(rule_set), is_judged=True)
        write_page(page, path)
        written = time.perf_counter() - began
        browser = playwright.chromium.launch(executable_path=chromium, args=['--no-sandbox'])
        opened, asked = [], []
        for number in range(_ROUNDS):
            tab = browser.new_page()
            began = time.perf_counter()
            tab.goto(f'file://{path}')
            tab.evaluate(_OPENED)
            opened.append(time.perf_counter() - began)
            asked.append(tab.evaluate(_ASK, 1.1 + 0.05 * number))
            answer = tab.locator('#answer').inner_text()
            tab.evaluate('document.querySelectorAll("details.jumps").forEach(d => d.open = true)')
            tab.wait_for_timeout(300)
            listed = tab.locator('[data-violation]').count()
            tab.close()
        browser.close()
        size = path.stat().st_size
    return {
        'metrics': {
            'page_MB': size / 1e6,
            'write_s': written,
            'open_s': statistics.median(opened),
            'what_if_ms': statistics.median(asked),
            'violations_listed': float(listed),
        },
        'peers': {},
        'settings': {
            'recordings': _RECORDINGS,
            'rows': len(timeline.data),
            'violations': len(timeline.violations),
            'answer': answer,
        },
    }


def _judged() -> tuple[RuleSet, Timeline]:
    """Return ten rules, and recordings that violate them five hundred times."""
    rng = np.random.default_rng(0)
    features = [Feature('speed', 'm/s'), Feature('turn', 'rad/s')]
    features += [Feature(f'clearance_{i}', 'm', family='clearance') for i in range(8)]
    space = FeatureSpace(tuple(features))
    family = space.families[0]
    literals = [
        (Literal(0, '>', 1.0),),
        (Literal(0, '<', -1.0),),
        (Literal(1, '>', 1.0),),
        (Literal(1, '<', -1.0),),
        (Literal(family, '<', 0.3),),
        (Literal(0, '>', 0.8), Literal(family, '<', 0.35)),
    ]
    rules = tuple(Rule(f'R{i}', item) for i, item in enumerate(literals))
    rule_set = RuleSet(space, rules, np.tile([0.0, 4.0], (len(space), 1)))
    each, rows = _SECONDS * _HZ, _RECORDINGS * _SECONDS * _HZ
    values = np.empty((rows, len(space)))
    time_s = np.tile(np.arange(each) / _HZ, _RECORDINGS)
    for column in range(len(space)):
        wave = np.sin(time_s * rng.uniform(0.1, 2.0) + rng.uniform(0, 6))
        noise = rng.normal(0.0, 0.02, rows)
        values[:, column] = (0.7 * wave if column < 2 else 2.0 + wave) + noise
    # Ten in each recording, of a second each, far enough from one another.
    for place in range(_VIOLATIONS):
        recording, number = divmod(place, _VIOLATIONS // _RECORDINGS)
        first = recording * each + (number * 340 + 100) * _HZ
        values[first : first + _HZ, 0] = rng.uniform(1.05, 1.5)
    recordings = np.repeat(np.arange(_RECORDINGS), each)
    times = (time_s * 1e9).astype(np.int64)
    sources = tuple({'name': f'drive_{i}', 'sha256': f'{i:064x}'} for i in range(_RECORDINGS))
    data = Dataset(
        names=space.names,
        values=values,
        stamps_ns=times,
        episodes=recordings,
        times_ns=times,
        recordings=recordings,
        sources=sources,
    )
    return rule_set, check_data(data, rule_set)
