# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The soak counts what it sent and looks at both nodes; how much they grow is for the long one."""

import pytest

pytest.importorskip('rclpy', reason="needs the extra 'ros'")


@pytest.mark.slow
def test_a_short_soak_counts_all_that_it_sent():
    from benchmarks.soak import run

    result = run(seconds=0.24)
    metrics, parts = result['metrics'], result['settings']['parts']
    assert metrics['messages'] == 240
    assert metrics['lost_messages'] == 0
    assert metrics['latency_p50_ms'] > 0.0
    assert {f'{node}_memory_mb' for node in ('monitor', 'gate')} <= set(metrics)
    assert len(parts) == 24
    assert all(part['gate_descriptors'] > 0 for part in parts)
