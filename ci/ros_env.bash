# Source this file to enter the project's ROS 2 environment and the packages of TREE, if they are built.
# VENV is the environment (default: .venv), TREE the tree (default: monorepo). The argument `without-overlay` leaves
# the packages out, to build them.
_root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
_options=$-
set +eu  # what ROS and colcon have written does not work with these
export VIRTUAL_ENV="${VENV:-$_root/.venv}"
export LUPIN_WORKSPACE="$VIRTUAL_ENV/workspace/${TREE:-monorepo}"
# What an earlier `source` has added leaves PATH.
PATH=$(sed "s#$VIRTUAL_ENV/[^:]*:##g" <<<"$PATH:")
PATH="$VIRTUAL_ENV/bin:${PATH%:}"
unset PYTHONDONTWRITEBYTECODE  # every process would compile every module again
if [ -e "$VIRTUAL_ENV/local_setup.bash" ]; then  # ROS is in the environment itself, and in no other place
    unset PYTHONPATH AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH
    # The Python of the wheels finds its libraries by these. A child of it may enter another environment.
    unset LD_LIBRARY_PATH _ROS_WHEELS_BOOTSTRAP_COMPLETE
    source "$VIRTUAL_ENV/local_setup.bash"
    # A trial on one machine must not reach other machines in the lab.
    export ROS_AUTOMATIC_DISCOVERY_RANGE="${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}"
    if [ "$ROS_DISTRO" = jazzy ]; then
        export FASTRTPS_DEFAULT_PROFILES_FILE="${FASTRTPS_DEFAULT_PROFILES_FILE:-$_root/ci/fast_dds.xml}"
    else
        export FASTDDS_DEFAULT_PROFILES_FILE="${FASTDDS_DEFAULT_PROFILES_FILE:-$_root/ci/fast_dds.xml}"
    fi
fi
if [ "${1:-}" != without-overlay ]; then
    for _workspace in "$VIRTUAL_ENV/workspace/ci/stand_ins" "$LUPIN_WORKSPACE"; do
        [ ! -e "$_workspace/install/local_setup.bash" ] || source "$_workspace/install/local_setup.bash"
    done
    [ -e "$LUPIN_WORKSPACE/install" ] || [ "${MAKELEVEL:-}" ] || echo "TREE=${TREE:-monorepo} is not built: make build" >&2
    # Each executable under its own name, also without `ros2 run`.
    for _folder in "$LUPIN_WORKSPACE"/install/lupin_*/lib/lupin_*/; do
        PATH="${_folder%/}:$PATH"
    done
fi
[[ $_options != *e* ]] || set -e
[[ $_options != *u* ]] || set -u
unset _root _options _workspace _folder
