# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The messages of the bridge. All modules import them from here."""

from lupin_greenhouse_msgs.msg import SensorReading, TagReading
from lupin_greenhouse_msgs.srv import GetTagReading

__all__ = ['GetTagReading', 'SensorReading', 'TagReading']
