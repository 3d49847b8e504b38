"""
Confirm that the camera sees the tag that the mission expects.

Imported by others: confirmation, detector, settings.
"""
