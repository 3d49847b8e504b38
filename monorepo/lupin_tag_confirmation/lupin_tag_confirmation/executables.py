"""The entry points of `ros2 run`. Each handles signals first, because importing rclpy takes a moment."""

from functools import partial

from lupin_greenhouse_bridge.runtime.process import start

confirm_tag = partial(start, 'lupin_tag_confirmation.confirm_tag')
