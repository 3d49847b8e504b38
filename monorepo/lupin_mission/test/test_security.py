"""The SROS2 policy of the mission allows what the nodes create on the graph, and nothing else."""

from pathlib import Path
from xml.etree import ElementTree

import pytest
from lupin_greenhouse_bridge.testing._helpers import executable, wait_until

OWN_POLICY = Path(__file__).resolve().parent.parent / 'security/policy.xml'
BRIDGES_POLICY = Path(__file__).resolve().parents[2] / 'lupin_greenhouse_bridge/security/policy.xml'
PARTS_OF_AN_ACTION = {
    'request': ('cancel_goal', 'get_result', 'send_goal'),
    'subscribe': ('feedback', 'status'),
}  # by the right that a caller needs


def rights_of(node: str, enclave: str, path=OWN_POLICY) -> dict[str, set[str]]:
    """Return the names that each right of a node covers, with `~` spelt out."""
    (profile,) = ElementTree.parse(path).findall(f".//enclave[@path='{enclave}']//profile[@node='{node}']")
    own = f'{profile.get("ns").rstrip("/")}/{node}'
    rights = {right: set() for right in ('reply', 'request', 'publish', 'subscribe')}
    for group in profile:
        ((right, value),) = group.attrib.items()
        assert value == 'ALLOW'
        names = {name.text.replace('~', own) for name in group}
        if right == 'call':
            for part, ends in PARTS_OF_AN_ACTION.items():
                rights[part] |= {f'{name}/_action/{end}' for name in names for end in ends}
        else:
            rights[right] |= names
    return rights


def created_by(graph, node: str, namespace: str) -> dict[str, set[str]]:
    """Return the names of what a node has created in its namespace, by the right that it needs."""
    if (node, namespace) not in graph.get_node_names_and_namespaces():
        return {}
    kinds = {'reply': 'service', 'request': 'client', 'publish': 'publisher', 'subscribe': 'subscriber'}
    created = {}
    for right, kind in kinds.items():
        found = getattr(graph, f'get_{kind}_names_and_types_by_node')(node, namespace)
        created[right] = {name.removeprefix(namespace) for name, _ in found}
    created['reply'].add(f'/{node}/get_type_description')  # which distros before Jazzy do not have
    return created


@pytest.mark.parametrize('path', [OWN_POLICY, BRIDGES_POLICY], ids=['mission', 'bridge'])
def test_ros2_security_generate_artifacts_can_read_it(path):
    """It takes every child of <enclaves> for an enclave, a comment too."""
    parser = ElementTree.XMLParser(target=ElementTree.TreeBuilder(insert_comments=True))
    enclaves = ElementTree.parse(path, parser).getroot().find('enclaves')
    assert [each.tag for each in enclaves] == ['enclave'] * len(list(enclaves.iter('enclave')))
    assert all(each.get('path').startswith('/') for each in enclaves)


@pytest.mark.parametrize('name', ['mission_orchestrator', 'confirm_tag'])
def test_a_node_may_do_what_it_does_and_nothing_more(start_mission, start_node, node, name):
    rights = rights_of(name, '/mission_launch')
    if name == 'confirm_tag':
        namespace = start_node([executable('lupin_tag_confirmation', name)]).namespace
    else:
        pytest.importorskip('nav2_msgs', reason='without nav2_msgs the mission does not call its action')
        namespace = start_mission(drive='nav2').namespace
    wait_until(lambda: created_by(node, name, namespace) == rights)


def test_the_launch_gives_each_node_what_its_own_enclave_gives():
    for node, enclave, path in (
        ('mission_orchestrator', '/mission', OWN_POLICY),
        ('greenhouse_bridge', '/greenhouse_bridge', BRIDGES_POLICY),
    ):
        assert rights_of(node, '/mission_launch') == rights_of(node, enclave, path)
