# PYTHON_ARGCOMPLETE_OK
# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The entry points of `ros2 run`. A node handles signals first, because importing rclpy takes a moment."""

from functools import partial

from lupin_greenhouse_bridge.runtime.process import start

bridge_node = partial(start, 'lupin_greenhouse_bridge.bridge_node')
read_tag = partial(start, 'lupin_greenhouse_bridge.reading.read_tag')
register_layout = partial(start, 'lupin_greenhouse_bridge.planning.register_layout')
read_on_sight = partial(start, 'lupin_greenhouse_bridge.reading.read_on_sight')
record_readings = partial(start, 'lupin_greenhouse_bridge.recording.record_readings')
readings_page = partial(start, 'lupin_greenhouse_bridge.display.readings_page', has_node=False)
show_readings = partial(start, 'lupin_greenhouse_bridge.display.show_readings')
approach_poses = partial(start, 'lupin_greenhouse_bridge.planning.approach_poses', has_node=False)
