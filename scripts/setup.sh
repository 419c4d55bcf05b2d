#!/usr/bin/env bash
# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
#
# Makes a virtual environment and installs this project into it, editable, with pinned versions.
# A second run finds the stamp of the first and returns at once.

set -euo pipefail

usage() {
  cat <<'END'
usage: scripts/setup.sh [option ...]
  --venv DIR               the environment, made if absent (default: .venv)
  --extras LIST            extras of the package (default: ros,train,report,dashboard,dev; '' for none)
  --pins FILE              versions to use (default: requirements/pins.txt)
  --requirements FILE      install exactly this list and not the package
  --system-site-packages   let the environment see the packages of the system's Python
END
}

say() { echo "setup: $*"; }
fail() { echo "setup: $*" >&2; exit 2; }

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
package=$root/src/occ_constraints_pkg
venv=$root/.venv
extras=ros,train,report,dashboard,dev
pins=$root/requirements/pins.txt
requirements=
venv_options=()
while [ $# -gt 0 ]; do
  case $1 in
    --system-site-packages) venv_options+=("$1"); shift; continue ;;
    -h | --help) usage; exit 0 ;;
    --venv | --extras | --pins | --requirements)
      [ $# -ge 2 ] || fail "option $1 needs a value." ;;
    *) usage >&2; fail "unknown option '$1'." ;;
  esac
  case $1 in
    --venv) venv=$2 ;;
    --extras) extras=$2 ;;
    --pins) pins=$2 ;;
    --requirements) requirements=$2 ;;
  esac
  shift 2
done
[ -n "$venv" ] || fail "--venv needs the name of a directory."
case $venv in /*) ;; *) venv=$PWD/$venv ;; esac
list=${requirements:-$pins}
[ -f "$list" ] || fail "no file '$list' with versions to install."
allowed=$(sed -n 's/^# python: //p' "$list")
[ -n "$allowed" ] || fail "'$list' lacks the line '# python: 3.x ...' that names the versions it is for."

# Everything that decides what gets installed. Sources are not part of it: the installation is
# editable, so they are seen without a reinstall.
stamp=$venv/.occ-setup
fingerprint() {
  local inputs=("$root/scripts/setup.sh" "$list")
  if [ -z "$requirements" ]; then
    inputs+=("$root/requirements/common.txt" "$package/setup.py" "$package/setup.cfg"
      "$package/occ_constraints_pkg/__init__.py")
  fi
  {
    "$venv/bin/python" --version
    echo "$root $venv $extras $requirements ${venv_options[*]}"
    sha256sum "${inputs[@]}"
  } 2>/dev/null | sha256sum | cut -d ' ' -f 1
}

unfinished='unfinished'
if [ -f "$stamp" ]; then
  recorded=$(cat "$stamp")
  [ "$recorded" != "$(fingerprint)" ] || exit 0
  if [ "$recorded" = "$unfinished" ] || ! "$venv/bin/python" --version >/dev/null 2>&1; then
    say "removing what an interrupted set-up or another Python left in $venv"
    rm -rf "$venv"
  fi
elif [ -e "$venv" ] && [ ! -f "$venv/pyvenv.cfg" ] && [ -n "$(ls -A "$venv")" ]; then
  fail "'$venv' exists and is not a virtual environment; name another directory with --venv."
fi

find_python() {
  local candidate version
  for candidate in python3 python3.13 python3.12 python3.11; do
    version=$("$candidate" -c 'import sys; print("%d.%d" % sys.version_info[:2])' 2>/dev/null) || continue
    case " $allowed " in *" $version "*) command -v "$candidate"; return 0 ;; esac
  done
  return 1
}

# Debian and Ubuntu ship Python without the part that makes environments.
make_venv() {
  local python=$1 log sudo=() apt_package
  log=$(mktemp)
  apt_package=${python##*/}-venv
  if "$python" -m venv "${venv_options[@]}" "$venv" >"$log" 2>&1; then rm -f "$log"; return; fi
  if ! grep -q -e 'ensurepip' -e 'No module named' "$log"; then
    cat "$log" >&2; rm -f "$log"
    fail "'$python -m venv $venv' failed, see above."
  fi
  rm -f "$log"
  if [ "$(id -u)" -ne 0 ]; then sudo=(sudo -n); fi
  if ! command -v apt-get >/dev/null || ! "${sudo[@]}" true 2>/dev/null; then
    fail "$python cannot make virtual environments: install the package $apt_package" \
      "(sudo apt-get install $apt_package) and run this again."
  fi
  say "installing $apt_package with apt-get, because $python cannot make virtual environments"
  "${sudo[@]}" apt-get update -qq >/dev/null
  "${sudo[@]}" env DEBIAN_FRONTEND=noninteractive \
    apt-get install -y -qq --no-install-recommends "$apt_package" >/dev/null
  rm -rf "${venv:?}/bin" "${venv:?}/lib" "$venv/pyvenv.cfg"
  "$python" -m venv "${venv_options[@]}" "$venv"
}

if [ ! -f "$venv/pyvenv.cfg" ]; then
  python=$(find_python) || fail "no Python of version ${allowed// / or } on the PATH; install one" \
    "(for example: sudo apt-get install python3 python3-venv) and run this again."
  say "making the environment $venv with $("$python" --version)"
  mkdir -p "$venv"
  echo "$unfinished" >"$stamp"
  make_venv "$python"
else
  version=$("$venv/bin/python" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
  case " $allowed " in
    *" $version "*) ;;
    *) fail "'$venv' has Python $version, allowed with ${list##*/} is ${allowed// / or }." ;;
  esac
  [ ! -f "$stamp" ] || echo "$unfinished" >"$stamp"
fi

pip() { "$venv/bin/python" -m pip --disable-pip-version-check --no-input "$@"; }
# Warnings are left out: they are about the machine's own pip configuration. Errors are shown.
install() { pip install --quiet --quiet "$@"; }

if [ -n "$requirements" ]; then
  say "installing $requirements"
  install --requirement "$requirements"
else
  target=$package
  [ -z "$extras" ] || target="${package}[${extras}]"
  say "installing ${target#"$root"/} with ${list##*/} (a few minutes the first time)"
  # The build tools come first and from the pins, so that pip fetches no others for the build.
  install --constraint "$pins" pip setuptools
  install --constraint "$pins" --no-build-isolation --editable "$target"
fi
fingerprint >"$stamp"
say "done"
