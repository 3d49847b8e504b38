# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""
A ROS 2 service that returns simulated climate readings for a greenhouse AprilTag.

Imported by others: contract, errors, interfaces, units, runtime, testing, and simulator except for
simulator.simulation.
"""
