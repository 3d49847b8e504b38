#!/usr/bin/env bash
# Install, build, test and start packages as the documents say. Run it as root in a container of a distro, such
# as ros:jazzy-ros-base, with the folders of the packages:
#
#     .github/distro.sh lupin_greenhouse_*       in a clone of the mirror
#     ci/distro.sh monorepo/lupin_*              in a clone of the monorepo
set -eo pipefail
mapfile -t packages < <(realpath "$@")
cd "$(mktemp -d)"

apt-get update
apt-get install --yes python3-venv python3-apriltag # rosdep has no key for the latter
rosdep update --rosdistro "$ROS_DISTRO"
rosdep install --rosdistro "$ROS_DISTRO" --from-paths "${packages[@]}" --ignore-src --yes
python3 -m venv --system-site-packages .venv
source .venv/bin/activate
pip install --no-deps 'mdp-greenhouse>=1.0.7'
source "/opt/ros/$ROS_DISTRO/setup.bash"

python3 -m colcon build --paths "${packages[@]}" --event-handlers console_direct+
source install/setup.bash
python3 -m colcon test --paths "${packages[@]}" --event-handlers console_direct+
python3 -m colcon test-result --verbose | tee result.txt
grep -E '[0-9]{3,} tests, 0 errors, 0 failures' result.txt # that hundreds ran, too

trap 'kill $(jobs -p)' EXIT
ros2 launch lupin_greenhouse_bridge greenhouse_bridge.launch.py &
messages=$(python3 -m colcon list --names-only --paths "${packages[@]}" | grep '_msgs$')
service="/greenhouse_bridge/get_tag_reading $messages/srv/GetTagReading"
timeout 60 ros2 service call $service "{tag_id: '1'}" | tee reply.txt
grep 'status=0' reply.txt
