# Source this file after ros_env.bash to set and make MIRROR_VENV, the environment that the mirror is tested in. With
# the wheels it has the other distro and the oldest supported simulator: two corners of the matrix at once.
export MIRROR_VENV=$VIRTUAL_ENV
if [ -e "$VIRTUAL_ENV/local_setup.bash" ]; then
    _other=$([ "$ROS_DISTRO" = kilted ] && echo jazzy || echo kilted)
    MIRROR_VENV=$VIRTUAL_ENV-$_other
    python ci/environment.py --venv "$MIRROR_VENV" --distro "$_other"
    _simulator=$("$MIRROR_VENV/bin/python" -c 'import importlib.metadata as m; print(m.version("mdp-greenhouse"))')
    [ "$_simulator" = 1.0.7 ] || "$MIRROR_VENV/bin/python" -m pip install -qq --no-deps mdp-greenhouse==1.0.7
    unset _other _simulator
fi
