"""The package's files agree with each other."""

from pathlib import Path
from xml.etree import ElementTree


def test_the_messages_of_detectors_are_a_dependency():
    """Only a source of detections imports apriltag_msgs, through the bridge's package."""
    manifest = ElementTree.parse(Path(__file__).resolve().parent.parent / 'package.xml').getroot()
    assert 'apriltag_msgs' in {depend.text for depend in manifest.iter('exec_depend')}
