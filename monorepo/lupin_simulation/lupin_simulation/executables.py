"""The entry points of `ros2 run`. Each handles signals first, because importing rclpy takes a moment."""

from functools import partial

from lupin_greenhouse_bridge.runtime.process import start

fake_camera = partial(start, 'lupin_simulation.fake_camera')
fake_navigator = partial(start, 'lupin_simulation.fake_navigator')
generate_world = partial(start, 'lupin_simulation.generate_world', has_node=False)
inspection = partial(start, 'lupin_simulation.inspection')
