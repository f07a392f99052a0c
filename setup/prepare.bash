# shellcheck shell=bash
# Sourced by ./feedopt if .venv or the build is missing or out of date: makes both; only one process at a time.
# shellcheck disable=SC2154  # root, venv, ready_stamp, built_stamp, built_manifest, ros_origin and the functions are ./feedopt's

setup_log=$root/log/setup.log
building_marker=$root/build/feedopt-building
ticker=

say() {
    printf 'feedopt: %s\n' "$*" >&2
}

# Runs a command with its output in the log, and prints its title and duration.
step() { # TITLE COMMAND...
    local title=$1 started=$SECONDS status=0
    shift
    printf '\n== %s: %s\n' "$title" "$*" >>"$setup_log"
    start_ticker "$title"
    "$@" >>"$setup_log" 2>&1 || status=$?
    stop_ticker
    if [[ $status -ne 0 ]]; then
        rm -f -- "$building_marker"
        say "$title: failed with exit code $status. The end of $setup_log:"
        tail -n 20 -- "$setup_log" | sed 's/^/    /' >&2
        exit 1
    fi
    say "$title: $((SECONDS - started)) s"
}

start_ticker() { # TITLE
    if [[ -t 2 ]]; then
        tick "$1" &
        ticker=$!
    else
        say "$1 ..."
    fi
}

stop_ticker() {
    if [[ -n $ticker ]]; then
        kill "$ticker" 2>/dev/null || true
        wait "$ticker" 2>/dev/null || true
        printf '\r\033[K' >&2
        ticker=
    fi
}

tick() { # TITLE
    local started=$SECONDS
    while kill -0 $$ 2>/dev/null; do
        printf '\r\033[Kfeedopt: %s ... %d s' "$1" "$((SECONDS - started))" >&2
        sleep 1
    done
}

prepare_workspace() {
    { mkdir -p -- "$root/log" && : >>"$root/log/setup.lock"; } 2>/dev/null ||
        die "cannot write to $root, the folder for .venv and the build"
    exec 9>"$root/log/setup.lock"
    if ! flock --nonblock 9; then
        say 'waiting for another ./feedopt that is preparing this workspace'
        flock 9
    fi
    trap stop_ticker EXIT
    trap 'exit 130' INT
    unset PYTHONDONTWRITEBYTECODE
    if ! venv_is_ready; then
        : >"$setup_log"
        make_venv
    fi
    if ! build_is_fresh; then
        build_workspace
    fi
    trap - EXIT INT
    exec 9>&-
}

# --- .venv ------------------------------------------------------------------------------------------------------------

make_venv() {
    local options=()
    choose_python
    choose_extras
    require_system_packages
    if [[ ! -d $venv ]]; then
        say 'the first use makes .venv (1.8 GB; 1.0 GB with FEEDOPT_EXTRAS=none) and builds the workspace; this takes about two minutes'
    fi
    rm -rf -- "$venv"
    if [[ $ros_origin != wheels ]]; then
        options=(--system-site-packages)
    fi
    step "making .venv with $("$python" --version)" "$python" -m venv "${options[@]}" "$venv"
    # Written before any step that can fail, so that the next attempt makes the same .venv.
    printf '%s\n' "$extras" >"$venv/feedopt-extras"
    step 'installing uv' "$venv/bin/python" -m pip install --disable-pip-version-check -r "$root/requirements/uv.txt"
    step 'installing the Python packages' install_requirements
    printf '%s\n' "${FEEDOPT_PYTHON:-$python}" >"$venv/feedopt-python"
    venv_recipe >"$ready_stamp"
}

# Sets python: $FEEDOPT_PYTHON, or the Python of the sourced ROS 2, or the first version for which the wheels exist.
choose_python() {
    local candidates=(python3.12 python3.11 python3) fits='import sys; sys.exit(sys.version_info[:2] not in ((3, 11), (3, 12)))'
    if [[ $ros_origin != wheels ]]; then
        candidates=(python3) fits='import rclpy'
    elif [[ $(uname -sm) != 'Linux x86_64' ]]; then
        die 'PyPI has ROS 2 for Linux on x86-64 only; on this computer, install ROS 2 Jazzy and source its setup.bash first'
    fi
    for python in ${FEEDOPT_PYTHON:-"${candidates[@]}"}; do
        if "$python" -c "$fits" >/dev/null 2>&1; then
            return 0
        fi
    done
    if [[ $ros_origin != wheels ]]; then
        die "ROS 2 Jazzy is sourced, but ${FEEDOPT_PYTHON:-python3} cannot import rclpy from $ros_origin" \
            'put the Python that ROS 2 was installed for first in PATH, or name it: FEEDOPT_PYTHON=/usr/bin/python3'
    fi
    die "Python 3.11 or 3.12 is needed, and ${FEEDOPT_PYTHON:-python3} is neither" \
        'install one (Ubuntu 24.04: apt-get install python3.12; Debian 12: apt-get install python3.11)' \
        'or name one that is not in PATH: FEEDOPT_PYTHON=/path/to/python3.12 ./feedopt'
}

# Sets extras: $FEEDOPT_EXTRAS, or the extras of the existing .venv, or those for a desktop and the tests.
choose_extras() {
    extras=view,test
    if [[ -n ${FEEDOPT_EXTRAS:-} ]]; then
        extras=$FEEDOPT_EXTRAS
    elif [[ -f $venv/feedopt-extras ]]; then
        extras=$(<"$venv/feedopt-extras")
    fi
    [[ $extras =~ ^(none|(view|test|bench)(,(view|test|bench))*)$ ]] ||
        die "FEEDOPT_EXTRAS=$extras cannot be used" 'give none, or some of view, test and bench with commas between'
}

require_system_packages() {
    local missing=() name tool
    name=$("$python" -c 'import sys; print("python%d.%d" % sys.version_info[:2])')
    "$python" -c 'import ensurepip, venv' 2>/dev/null || missing+=("$name-venv")
    "$python" -c 'import os, sysconfig; os.stat(sysconfig.get_path("include") + "/Python.h")' 2>/dev/null ||
        missing+=("$name-dev")
    for tool in "${CC:-cc}" "${CXX:-c++}" make; do
        command -v "${tool%% *}" >/dev/null || { missing+=(build-essential) && break; }
    done
    if [[ ${#missing[@]} -eq 0 ]]; then
        return 0
    fi
    if [[ $EUID -ne 0 ]] || ! command -v apt-get >/dev/null; then
        die "missing: ${missing[*]}" "install it and try again, on Debian and Ubuntu: sudo apt-get install ${missing[*]}"
    fi
    step "installing ${missing[*]} with apt-get" install_system_packages "${missing[@]}"
}

install_system_packages() {
    apt-get update && DEBIAN_FRONTEND=noninteractive apt-get install --yes --no-install-recommends "$@"
}

install_requirements() {
    local name files=(run)
    # shellcheck disable=SC2206  # one word each
    [[ $extras == none ]] || files+=(${extras//,/ })
    if [[ $ros_origin == wheels ]]; then
        files+=(ros colcon)
    elif ! "$venv/bin/python" -c 'import colcon_core' 2>/dev/null; then
        files+=(colcon)
    fi
    if ! has_cmake; then
        files+=(cmake)
    fi
    set --
    for name in "${files[@]}"; do
        set -- "$@" --requirement "$root/requirements/$name.txt"
    done
    # uv does not read the mirrors and certificates in the configuration of pip.
    "$venv/bin/uv" pip install --python "$venv/bin/python" "$@" || "$venv/bin/python" -m pip install "$@"
}

has_cmake() { # at least 3.19, for cmake_language(DEFER)
    local version
    version=$(cmake --version 2>/dev/null | head -n 1) || return 1
    [[ $(printf '%s\n' 3.19 "${version##* }" | sort --version-sort | head -n 1) == 3.19 ]]
}

# --- the build --------------------------------------------------------------------------------------------------------

build_workspace() {
    local packages title now
    if [[ -f $building_marker || ! -f $built_stamp || $(<"$built_stamp") != "$(build_recipe)" ]]; then
        rm -rf -- "$root/build" "$root/install"
    fi
    mkdir -p -- "$root/build" "$root/install"
    # State of the sources before the build: files that change during the build are built again.
    build_recipe >"$building_marker"
    now=$(built_sources)
    forget_vanished_sources
    mapfile -t packages < <(changed_packages <<<"$now")
    if [[ ${#packages[@]} -gt 0 ]]; then
        title="building ${packages[*]}"
        [[ ${#packages[@]} -le 2 ]] || title='building the workspace'
        # A renamed executable would remain; colcon writes all executables again.
        rm -rf -- "${packages[@]/#/$root/install/lib/}"
        step "$title" colcon_build "${packages[@]}"
    fi
    printf '%s\n' "$now" >"$built_manifest"
    step 'compiling the numerical code' compile_kernels
    mv -- "$building_marker" "$built_stamp"
}

# Code compiled earlier is only loaded. After an edit of a Python module, the first command that needs it compiles it.
compile_kernels() {
    (
        enter_environment
        exec "$venv/bin/python" -P -m feedopt_core.pipeline.warm_up
    )
}

# Results of a deleted file would remain: delete everything that its package has built and installed.
forget_vanished_sources() {
    local source package
    [[ -f $built_manifest ]] || return 0
    while read -r _ source; do
        if [[ ! -e $root/$source ]]; then
            package=feedopt_config
            [[ $source != src/* ]] || package=$(cut -d / -f 2 <<<"$source")
            rm -rf -- "$root/build/$package" "$root/install"/{lib,share}/"$package"
        fi
    done <"$built_manifest"
    find "$root/install" -xtype l -delete
}

# Names of the packages with a file that was added, deleted or changed since the last build; before the first, all.
changed_packages() { # <SOURCES
    local before=/dev/null description folder changed
    [[ ! -f $built_manifest ]] || before=$built_manifest
    # Lines that are in only one of the two lists, without the hash.
    mapfile -t changed < <(LC_ALL=C comm -3 <(LC_ALL=C sort -- "$before") <(LC_ALL=C sort) | sed 's/^\t*[0-9a-f]*  //')
    for description in "$root"/config/package.xml "$root"/src/*/package.xml; do
        folder=$(dirname -- "${description#"$root"/}")
        if grep -q "^$folder/" < <(printf '%s\n' "${changed[@]}"); then
            sed -n 's|.*<name>\(.*\)</name>.*|\1|p' "$description"
        fi
    done
}

colcon_build() { # PACKAGE...
    local cmake_args=(-DBUILD_TESTING=OFF -DCMAKE_BUILD_TYPE=Release "-DPython3_EXECUTABLE=$venv/bin/python")
    if [[ $ros_origin == wheels ]]; then
        cmake_args+=("-DCMAKE_PROJECT_INCLUDE=$root/setup/ros_wheels.cmake")
    fi
    (
        cd -- "$root" || exit
        enter_environment
        if [[ $ros_origin == wheels ]]; then
            export CMAKE_PREFIX_PATH=$venv
        fi
        exec "$venv/bin/python" -m colcon --log-base log/colcon build --base-paths config src --merge-install \
            --symlink-install --event-handlers console_cohesion+ --packages-select "$@" --cmake-args "${cmake_args[@]}"
    )
}
