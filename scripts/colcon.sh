#!/usr/bin/env bash
# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
#
# Builds the workspace ros2_ws with a colcon from PyPI, checks what `ros2 run` and `ros2 launch` will
# find, runs the package's own tests, and starts the monitor out of the install tree. `--build-only`
# leaves out the last two.

set -euo pipefail

say() { echo "colcon: $*"; }
fail() { echo "colcon: $*" >&2; exit 1; }

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
tools=$root/.venv-colcon
start=yes
case ${1:-} in
  '') ;;
  --build-only) start=no ;;
  -h | --help) say 'usage: scripts/colcon.sh [--build-only]'; exit 0 ;;
  *) fail "usage: scripts/colcon.sh [--build-only]" ;;
esac

"$root/scripts/setup.sh" --venv "$tools" --requirements "$root/requirements/colcon.txt"
cd "$root/ros2_ws"

# The interpreter that runs colcon decides for which Python it builds; what an outer environment or
# another workspace has put on these paths must not get in.
colcon() { env -u PYTHONPATH -u PYTHONHOME PATH="$tools/bin:$PATH" "$tools/bin/colcon" "$@"; }

# A faulty package.xml makes colcon take the package for a plain Python one, and then `ros2 run` does
# not find it, with no error at build time.
listed=$(colcon list)
say "$listed"
[[ $listed == *'(ros.ament_python)'* ]] || fail "colcon does not take the package for ament_python."

if ! colcon build --event-handlers console_direct-; then
  cat log/latest_build/occ_constraints_pkg/stdout_stderr.log >&2
  fail "the build failed, see above."
fi
prefix=$PWD/install/occ_constraints_pkg
for name in occ sim policy recorder player tree_learner monitor gate constrained_learner dashboard; do
  [ -x "$prefix/lib/occ_constraints_pkg/$name" ] || fail "lib/occ_constraints_pkg/$name is missing."
done
for path in "$root"/src/occ_constraints_pkg/{package.xml,launch/*.py,config/*}; do
  name=${path#"$root/src/occ_constraints_pkg/"}
  [ -f "$prefix/share/occ_constraints_pkg/$name" ] || fail "share/occ_constraints_pkg/$name is missing."
done
[ -f "$prefix/share/ament_index/resource_index/packages/occ_constraints_pkg" ] \
  || fail "the package is missing from the ament index."
say "ros2_ws/install holds the nodes, launch files and parameters"
[ "$start" = yes ] || exit 0

# With what apt has for monitor and gate: the tests need no extra, and those of nodes skip here, where
# rclpy is not.
rm -rf build/occ_constraints_pkg/pytest.xml
colcon test --event-handlers console_direct- --return-code-on-test-failure || {
  colcon test-result --verbose >&2
  fail "tests of the package failed, see above."
}
results=$(colcon test-result --all)
say "$results"
if ! [[ $results =~ ([0-9]+)\ tests ]] || ((BASH_REMATCH[1] <= 100)); then
  fail "colcon test ran no more than 100 tests."
fi

# NumPy and rclpy come from .venv, the package from the install tree.
export PATH="$root/.venv/bin:$PATH"
# The generated script reads variables that may be unset.
set +u
# shellcheck source=/dev/null
source install/setup.bash
set -u
[[ $(python3 -c 'import occ_constraints_pkg; print(occ_constraints_pkg.__file__)') == "$prefix"/* ]] \
  || fail "python3 does not import the package from $prefix."

say "starting the monitor out of the install tree, Ctrl-C after 10 s"
status=0
timeout --preserve-status --signal INT --kill-after 10 10 \
  "$prefix/lib/occ_constraints_pkg/monitor" </dev/null || status=$?
[ "$status" -eq 0 ] || fail "the monitor ended with exit code $status instead of 0."
say "the monitor ran and ended cleanly"
