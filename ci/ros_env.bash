# Source me: puts this shell into the project's ROS 2 environment, and over it TREE's packages, where built.
# VENV names the environment (default: .venv), TREE the tree (default: monorepo); an argument
# `without-overlay` leaves the packages out, for building them.
_root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
source "${VENV:-$_root/.venv}/local_setup.bash"
export LUPIN_WORKSPACE="$VIRTUAL_ENV/workspace/${TREE:-monorepo}"
export LUPIN_EXECUTABLES="$LUPIN_WORKSPACE/install/lupin_greenhouse_bridge/lib/lupin_greenhouse_bridge"
if [ "${1:-}" != without-overlay ] && [ -e "$LUPIN_WORKSPACE/install/local_setup.bash" ]; then
    source "$LUPIN_WORKSPACE/install/local_setup.bash"
fi
unset _root
