"""
List what rosdep can install of the dependencies of our packages, from a clone of ros/rosdistro.

    git clone --depth 1 https://github.com/ros/rosdistro
    python ci/rosdep_keys.py rosdistro > ci/rosdep_keys.txt

Each line has a key and its distros: those that release the package or, for a system key, those with a rule
for their Ubuntu release. The table comes from rosdistro's commit 8468e88ccd of 2026-08-22.
"""

import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import yaml

ROOT = Path(__file__).resolve().parent.parent
UBUNTU = {'humble': 'jammy', 'jazzy': 'noble', 'kilted': 'noble'}


def dependencies(manifest: Path) -> dict[str, set[str]]:
    """Return the kinds of dependency (depend, exec_depend, ...) of each key in a package.xml."""
    found: dict[str, set[str]] = {}
    for element in ElementTree.parse(manifest).getroot():  # noqa: S314 - our own
        if element.tag.endswith('depend') and element.text:
            found.setdefault(element.text, set()).add(element.tag)
    return found


def manifests() -> list[Path]:
    """Return the package.xml of each package of both trees."""
    return sorted(
        path for tree in ('monorepo', 'lupin_greenhouse_ros') for path in ROOT.glob(f'{tree}/*/package.xml')
    )


def foreign_keys() -> set[str]:
    """Return the keys of all packages, without the packages of these trees."""
    return {key for path in manifests() for key in dependencies(path)} - {
        path.parent.name for path in manifests()
    }


def resolvable(rosdistro: Path) -> dict[str, set[str]]:
    """Return the distros in which rosdep resolves each of our keys."""

    def load(name: str) -> dict[str, Any]:
        text = (rosdistro / name).read_text(encoding='utf-8')
        content: dict[str, Any] = yaml.load(text, Loader=yaml.CSafeLoader)
        return content

    rules = load('rosdep/base.yaml') | load('rosdep/python.yaml')
    found: dict[str, set[str]] = {key: set() for key in foreign_keys()}
    for distro, ubuntu in UBUNTU.items():
        released = set()
        for name, repository in load(f'{distro}/distribution.yaml')['repositories'].items():
            if 'version' in repository.get('release', {}):
                released.update(repository['release'].get('packages', [name]))
        for key, distros in found.items():
            rule = rules.get(key, {}).get('ubuntu')
            if isinstance(rule, dict) and not {'apt', 'pip'} & rule.keys():
                rule = rule.get(ubuntu, rule.get('*'))
            if key in released or rule:
                distros.add(distro)
    return found


def main() -> int:
    """Print the table from the clone of rosdistro on the command line."""
    if len(sys.argv) != 2:
        print('usage: rosdep_keys.py ROSDISTRO_CLONE', file=sys.stderr)
        return 2
    for key, distros in sorted(resolvable(Path(sys.argv[1])).items()):
        print(key, *sorted(distros))
    return 0


if __name__ == '__main__':
    sys.exit(main())
