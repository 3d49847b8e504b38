# Source this file to enter the project's ROS 2 environment and the packages of TREE, if they are built.
# VENV is the environment (default: .venv), TREE the tree (default: monorepo). The argument `without-overlay`
# leaves the packages out, to build them.
[ -n "${BASH_VERSION:-}" ] || { echo 'ci/ros_env.bash is for bash: run bash first' >&2; return 1; }
[[ "${BASH_SOURCE[0]}" != "$0" ]] || { echo "it must be sourced: write source $0" >&2; exit 1; }
case "${TREE:-monorepo}" in
    monorepo|lupin_greenhouse_ros) ;;
    *)  [ "${1:-}" = without-overlay ] || {
            echo "TREE=$TREE is not a tree: set TREE=monorepo or TREE=lupin_greenhouse_ros" >&2; return 1; } ;;
esac
_root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
export VIRTUAL_ENV="${VENV:-$_root/.venv}"
export PATH="$VIRTUAL_ENV/bin:$PATH"
# The packages of a tree that this shell has entered before leave the paths.
for _name in PATH PYTHONPATH LD_LIBRARY_PATH AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH; do
    _paths=":${!_name:-}:"
    while [[ "$_paths" == *":${LUPIN_WORKSPACE:-none}/"* ]]; do
        _rest=${_paths#*":$LUPIN_WORKSPACE/"}
        _paths="${_paths%%":$LUPIN_WORKSPACE/"*}:${_rest#*:}"
    done
    [ "$_paths" = ":${!_name:-}:" ] || { _paths=${_paths#:}; export "$_name=${_paths%:}"; }
done
unset _paths _rest
unset PYTHONDONTWRITEBYTECODE  # every process would compile every module again
if [ -e "$VIRTUAL_ENV/local_setup.bash" ]; then  # ROS is in the environment itself, and in no other place
    unset PYTHONPATH AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH
    # The Python of the wheels finds its libraries by these. A child of it may enter another environment.
    unset LD_LIBRARY_PATH _ROS_WHEELS_BOOTSTRAP_COMPLETE
    source "$VIRTUAL_ENV/local_setup.bash"
    # A trial on one machine must not reach other machines in the lab.
    export ROS_AUTOMATIC_DISCOVERY_RANGE="${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}"
    # Kilted warns of the variable that Jazzy needs.
    for _name in FASTDDS_DEFAULT_PROFILES_FILE FASTRTPS_DEFAULT_PROFILES_FILE; do
        [ "${!_name:-}" != "$_root/ci/fast_dds.xml" ] || unset "$_name"
    done
    [ "$ROS_DISTRO" = jazzy ] || _name=FASTDDS_DEFAULT_PROFILES_FILE
    export "$_name=${!_name:-$_root/ci/fast_dds.xml}"
    unset _name
fi
export LUPIN_WORKSPACE="$VIRTUAL_ENV/workspace/${TREE:-monorepo}"
export LUPIN_EXECUTABLES="$LUPIN_WORKSPACE/install/lupin_greenhouse_bridge/lib/lupin_greenhouse_bridge"
# Each executable under its own name, also without `ros2 run`.
for _name in lupin_greenhouse_bridge lupin_mission lupin_simulation lupin_tag_confirmation; do
    PATH="$PATH:$LUPIN_WORKSPACE/install/$_name/lib/$_name"
done
unset _name
if [ "${1:-}" != without-overlay ] && [ -e "$LUPIN_WORKSPACE/install/local_setup.bash" ]; then
    source "$LUPIN_WORKSPACE/install/local_setup.bash"
elif [[ "${1:-}" != without-overlay && -z "${MAKELEVEL:-}" ]]; then  # make itself builds what it needs
    _other=lupin_greenhouse_ros
    [ "${TREE:-monorepo}" = monorepo ] || _other=monorepo
    [ -e "$VIRTUAL_ENV/workspace/$_other/install" ] && _other=", or export TREE=$_other, which is built" || _other=
    echo "TREE=${TREE:-monorepo} is not built: make build TREE=${TREE:-monorepo}$_other" >&2
    unset _other
fi
unset _root
