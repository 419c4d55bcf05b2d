#!/usr/bin/env python3
# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Record the small bags in bags/ anew: .venv/bin/python scripts/make_bags.py [directory]."""

import argparse
import shutil
import tempfile
from pathlib import Path

from occ_constraints_pkg.demo.processes import private_domain
from occ_constraints_pkg.demo.recordings import record_episodes

# name: world, driver, robots, episodes of each robot
BAGS = {
    'simple_nav_expert': ('simple_nav', 'expert', 10, 20),
    'simple_nav_straight': ('simple_nav', 'straight', 10, 20),
    'point_goal_expert': ('PointGoal1', 'expert', 10, 1),
    'point_goal_straight': ('PointGoal1', 'straightv', 5, 1),
}


def main() -> None:
    """Record every bag that is not there yet."""
    parser = argparse.ArgumentParser(description='Record the small bags anew that are not there.')
    parser.add_argument('directory', nargs='?', default='bags', type=Path)
    target = parser.parse_args().directory
    for name, (world, driver, robots, episodes) in BAGS.items():
        if (target / name / 'metadata.yaml').exists():
            print(f'{target / name} is there already')
            continue
        with tempfile.TemporaryDirectory() as directory, private_domain() as domain:
            recorded = Path(directory) / name
            record_episodes(
                recorded,
                Path(directory) / 'logs',
                domain,
                world=world,
                driver=driver,
                robots=robots,
                episodes=episodes,
            )
            # Beside the README, which a new bag's directory cannot have yet.
            shutil.copytree(recorded, target / name, dirs_exist_ok=True)
        print(f'{target / name} recorded')


if __name__ == '__main__':
    main()
