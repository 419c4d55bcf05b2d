# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""The images and the compose file, without a container engine."""

import subprocess

from ruamel.yaml import YAML


def test_compose_runs_the_nodes_in_one_network_and_one_shared_memory(root, nodes):
    services = YAML(typ='safe').load(root / 'docker' / 'compose.yaml')['services']
    assert {'sim', 'monitor', 'recorder'} <= set(services) <= set(nodes)
    for name, service in services.items():
        assert f'occ node {name}' in ' '.join(service['command'])
        assert service['network_mode'] == 'host'
        assert service['ipc'] == 'host'


def test_images_are_set_up_by_the_script_that_make_uses(root):
    for name in ('Dockerfile.jazzy', 'Dockerfile.slim'):
        assert 'RUN scripts/setup.sh' in (root / 'docker' / name).read_text()


def test_images_get_every_folder_that_the_scripts_read(root):
    lines = (root / '.dockerignore').read_text().splitlines()
    kept = {line[1:] for line in lines if line.startswith('!')}
    assert {'src', 'ros2_ws/src', 'requirements', 'scripts', 'docker/entrypoint.sh'} <= kept


def test_entrypoint_sources_the_workspace_and_returns_the_exit_code(root, tmp_path):
    install = tmp_path / 'ros2_ws' / 'install'
    install.mkdir(parents=True)
    # Reads an unset variable, as the files that colcon writes do.
    (install / 'setup.bash').write_text('export FROM_WORKSPACE="yes$SURELY_UNSET"\n')
    tools = tmp_path / '.venv' / 'bin'
    tools.mkdir(parents=True)
    (tools / 'occ').write_text('#!/bin/sh\necho "$FROM_WORKSPACE $1"\nexit 3\n')
    (tools / 'occ').chmod(0o755)
    done = subprocess.run(
        [root / 'docker' / 'entrypoint.sh', 'occ', 'node'],
        env={'PATH': '/usr/bin:/bin', 'OCC_HOME': str(tmp_path)},
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stdout) == (3, 'yes node\n'), done.stderr
