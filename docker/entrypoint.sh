#!/usr/bin/env bash
# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
#
# Runs a command in the environment of the image: apt ROS and the colcon workspace where they are
# there (Dockerfile.jazzy), and the virtual environment.

set -eo pipefail # not -u: the set-up files of ROS read variables that may be unset

home=${OCC_HOME:-/opt/occ}
for setup in "/opt/ros/${ROS_DISTRO:-jazzy}/setup.bash" "$home/ros2_ws/install/setup.bash"; do
  if [ -f "$setup" ]; then
    # shellcheck source=/dev/null
    source "$setup"
  fi
done
export PATH="$home/.venv/bin:$PATH"
exec "$@"
