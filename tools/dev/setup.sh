#!/usr/bin/env bash
# Makes a bare Debian 12 or Ubuntu 24.04 ready: system packages, .venv, Python
# packages, C++ build. Safe to run again; finished steps are skipped.
#
#   SIM2VR_PYTHON=python3.12   the interpreter for .venv (default: the system's)
#   SIM2VR_JOBS=4              compile jobs (default: all cores, one per GiB of memory)
#   SIM2VR_NO_APT=1            do not touch system packages
#   SIM2VR_TORCH=cpu|default   which torch build (default: cpu unless there is an NVIDIA GPU)
#   SIM2VR_VERBOSE=1           show the output of every step
set -euo pipefail
cd "$(dirname "$0")/../.."
readonly root=$PWD venv=.venv stamps=.venv/.sim2vr log_dir=build/log
readonly py=$venv/bin/python
mkdir -p "$log_dir"

step_number=0 packages=
trap '[[ -z $packages ]] || kill -- "-$packages" 2>/dev/null || true' EXIT
say() { printf '[%d/5] %s\n' "$step_number" "$*"; }
step() { step_number=$((step_number + 1)); }

# fail <step> <mending command> [log]
fail() {
  if [[ -n ${3:-} && -s ${3:-} ]]; then
    echo "----- last lines of $3"
    grep -nE 'error:|FAILED:|ERROR' "$3" | head -n 20 || true
    tail -n 30 "$3"
    echo "-----"
  fi >&2
  printf 'setup failed at: %s\nto mend it: %s\n' "$1" "$2" >&2
  exit 1
}

# logged <log> <command...>: run quietly into a log file, or loudly on request
logged() {
  local log=$1
  shift
  if [[ -n ${SIM2VR_VERBOSE:-} ]]; then "$@" 2>&1 | tee "$log"; else "$@" >"$log" 2>&1 </dev/null; fi
}

stamp_is() { [[ -f $stamps/$1 && $(<"$stamps/$1") == "$2" ]]; }
stamp() { mkdir -p "$stamps" && printf '%s' "$2" >"$stamps/$1"; }
digest() { sha256sum "$@" | sha256sum | cut -d ' ' -f 1; }

# ---------------------------------------------------------------- 1 system packages
apt_missing() {  # apt_missing <kinds>: packages of these kinds that are not installed
  local wanted
  wanted=$(awk -v kinds="$1" 'NF == 2 && $1 !~ /^#/ && index(kinds, $1) { print $2 }' packages.txt)
  # shellcheck disable=SC2086
  comm -23 <(sort -u <<<"$wanted") \
    <(dpkg-query -W -f '${db:Status-Status} ${Package}\n' $wanted 2>/dev/null | sed -n 's/^installed //p' | sort -u)
}

as_root() {
  if [[ $EUID == 0 ]]; then env DEBIAN_FRONTEND=noninteractive "$@"; else sudo env DEBIAN_FRONTEND=noninteractive "$@"; fi
}

step
if [[ -n ${SIM2VR_NO_APT:-} ]] || ! command -v dpkg-query >/dev/null; then
  say "system packages: not checked (no dpkg, or SIM2VR_NO_APT is set); packages.txt lists what is needed"
else
  mapfile -t missing < <(apt_missing "build runtime")
  if ((${#missing[@]} == 0)); then
    say "system packages: all installed"
  else
    say "system packages: installing ${missing[*]}"
    by_hand="apt-get update && apt-get install -y --no-install-recommends ${missing[*]}"
    if [[ $EUID != 0 ]] && ! command -v sudo >/dev/null; then
      fail "system packages (no root rights and no sudo)" "as root: $by_hand"
    fi
    apt_install=(apt-get install -y --no-install-recommends -o Dpkg::Use-Pty=0)
    # Package lists may be absent (containers) or stale: update only when the install fails.
    if ! logged "$log_dir/apt.log" as_root "${apt_install[@]}" "${missing[@]}"; then
      logged "$log_dir/apt.log" as_root apt-get update || fail "apt-get update" "check the network, then: make setup" "$log_dir/apt.log"
      logged "$log_dir/apt.log" as_root "${apt_install[@]}" "${missing[@]}" \
        || fail "system packages" "$by_hand" "$log_dir/apt.log"
    fi
    mapfile -t optional < <(apt_missing "optional")
    for package in "${optional[@]}"; do
      logged "$log_dir/apt-optional.log" as_root "${apt_install[@]}" "$package" \
        || say "system packages: optional $package is not available here, going on without it"
    done
  fi
fi

# ---------------------------------------------------------------- 2 virtual environment
python_is_new_enough() { "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; }

pick_python() {
  local candidate
  for candidate in "${SIM2VR_PYTHON:-/usr/bin/python3}" python3 python3.13 python3.12 python3.11; do
    if command -v "$candidate" >/dev/null && python_is_new_enough "$candidate"; then
      command -v "$candidate"
      return
    fi
    [[ -n ${SIM2VR_PYTHON:-} ]] && return 1
  done
  return 1
}

step
if [[ -d $venv ]] && { ! python_is_new_enough "$py" || { [[ -f $stamps/root ]] && ! stamp_is root "$root"; }; }; then
  say "virtual environment: .venv is broken or belongs to another folder, making it anew"
  rm -rf "$venv"
fi
if [[ -d $venv ]]; then
  say "virtual environment: .venv with $("$py" -V)"
else
  python=$(pick_python) || fail "virtual environment: no Python 3.11 or newer" \
    "apt-get install python3 python3-venv python3-dev, or SIM2VR_PYTHON=/path/to/python3.12 make setup"
  logged "$log_dir/venv.log" "$python" -m venv "$venv" \
    || { rm -rf "$venv"; fail "virtual environment" "apt-get install -y python3-venv && make setup" "$log_dir/venv.log"; }
  say "virtual environment: .venv made with $("$py" -V)"
fi
stamp root "$root"

# ---------------------------------------------------------------- 3 Python packages
pip() { "$py" -m pip --disable-pip-version-check --no-input "$@"; }

install_torch() {
  # The plain torch wheel for Linux brings several GB of CUDA libraries along.
  # Without an NVIDIA GPU the CPU build is taken: from the configured package
  # indexes when they have it, else from PyTorch's own CPU index.
  local version choice=${SIM2VR_TORCH:-}
  version=$(sed -n 's/^torch==//p' requirements.lock)
  if [[ -z $choice ]]; then
    if command -v nvidia-smi >/dev/null && nvidia-smi -L >/dev/null 2>&1; then choice=default; else choice=cpu; fi
  fi
  [[ $choice == cpu ]] || return 0  # requirements.lock installs the plain build
  local installed
  installed=$("$py" -c 'from importlib.metadata import version; print(version("torch"))' 2>/dev/null || true)
  [[ ${installed%%+*} == "$version" ]] && return 0
  logged "$log_dir/pip-torch.log" pip install --no-deps "torch==$version+cpu" && return 0
  logged "$log_dir/pip-torch.log" pip install --no-deps --retries 1 --timeout 20 \
    --index-url https://download.pytorch.org/whl/cpu "torch==$version+cpu" && return 0
  say "Python packages: no CPU build of torch $version within reach, taking the default build (large)"
}

step
python_version=$("$py" -c 'import platform; print(platform.python_version())')
deps_key="$(digest requirements.lock)-$python_version"
if stamp_is deps "$deps_key"; then
  say "Python packages: as in requirements.lock"
else
  say "Python packages: installing requirements.lock while the C++ parts compile (some minutes the first time)"
  # The extension module needs this one; the rest takes minutes of one core, so that the compiler need not wait.
  logged "$log_dir/pip.log" pip install "$(grep '^pybind11==' requirements.lock)" \
    || fail "Python packages" "check the network, then: make setup" "$log_dir/pip.log"
  set -m  # a process group of its own, which the trap ends
  { install_torch && logged "$log_dir/pip.log" pip install -r requirements.lock; } &
  packages=$!
  set +m
fi

# ---------------------------------------------------------------- 4 C++ build
jobs=${SIM2VR_JOBS:-$(awk -v cores="$(nproc)" '/MemTotal/ { gib = int($2 / 1048576); print (gib < 1) ? 1 : (gib < cores ? gib : cores) }' /proc/meminfo)}

step
configured_for=$(sed -n 's/^CMAKE_HOME_DIRECTORY:INTERNAL=//p' build/release/CMakeCache.txt 2>/dev/null || true)
if [[ -n $configured_for && $configured_for != "$root" ]]; then rm -rf build/release; fi
logged "$log_dir/cmake.log" cmake --preset release -DPython_EXECUTABLE="$root/$py" -DSIM2VR_BUILD_BINDINGS=ON \
  || fail "C++ configure" "read build/log/cmake.log; after mending: make setup (or make clean setup)" "$log_dir/cmake.log"
[[ -x build/release/app_runtime/sim2vr-app ]] || say "C++ build: compiling with $jobs jobs (some minutes the first time)"
logged "$log_dir/build.log" cmake --build --preset release --parallel "$jobs" --target sim2vr_installed \
  || fail "C++ build" "mend the errors above (a compiler killed for lack of memory: SIM2VR_JOBS=1), then: make setup" "$log_dir/build.log"
# Headers and a CMake package for games of one's own: find_package looks beside the active bin/.
logged "$log_dir/install.log" cmake --install build/release --component development --prefix "$venv" \
  || fail "installing headers" "read build/log/install.log, then: make setup" "$log_dir/install.log"
if [[ -n $packages ]]; then
  wait "$packages" \
    || fail "Python packages" "check the network, then: $py -m pip install -r requirements.lock" "$log_dir/pip.log"
  stamp deps "$deps_key"
  packages=
fi
say "C++ build: build/release/app_runtime is up to date (sim2vr-app, the OpenXR runtime, its layer, the virtual clock)"

# ---------------------------------------------------------------- 5 the package itself
step
package_key="$(digest pyproject.toml VERSION)-$root-$python_version"
if stamp_is package "$package_key"; then
  say "sim2vr-harness: installed from this folder (editable)"
else
  # The extension module was placed in python/ by the C++ build, so the editable
  # install only needs the Python side.
  SKBUILD_WHEEL_CMAKE=false SKBUILD_EDITABLE_MODE=inplace \
    logged "$log_dir/pip-editable.log" pip install --no-deps --no-build-isolation --force-reinstall -e . \
    || fail "installing sim2vr-harness" "$py -m pip install --no-build-isolation -e ." "$log_dir/pip-editable.log"
  stamp package "$package_key"
  say "sim2vr-harness: installed from this folder (editable)"
fi
