"""
A mission that visits the tags, reads each once, and reports.

Imported by others: nav2_drive, settings, world.
"""
