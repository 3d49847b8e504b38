# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""The SROS2 policy allows what the nodes create on the graph, and nothing else."""

import signal
from pathlib import Path
from xml.etree import ElementTree

import pytest
from lupin_greenhouse_bridge.reading import read_tag
from lupin_greenhouse_bridge.runtime import process
from lupin_greenhouse_bridge.testing import wait_until

POLICY = ElementTree.parse(Path(__file__).resolve().parent.parent / 'security/policy.xml').getroot()
# Distros before Jazzy do not have it; an unused right does no harm.
NOT_EVERYWHERE = {'get_type_description'}


def allowed(node, kind, right):
    """Return the names in a node's profile of the policy, without the node's own name."""
    (profile,) = [each for each in POLICY.iter('profile') if each.get('node') == node]
    groups = [group for group in profile if group.get(right) == 'ALLOW']
    return {name.text.replace('~/', '') for group in groups for name in group if group.tag == kind}


def names(listed, node, namespace):
    return {name.removeprefix(f'{namespace}/{node}/').replace(namespace, '', 1) for name, _ in listed}


def test_the_policy_has_the_form_of_sros2_0_2_0():
    assert (POLICY.tag, POLICY.attrib) == ('policy', {'version': '0.2.0'})
    enclaves = list(POLICY.iter('enclave'))
    assert [each.get('path') for each in enclaves] == ['/greenhouse_bridge', '/read_tag']
    for profile in POLICY.iter('profile'):
        assert profile.attrib.keys() == {'ns', 'node'}
        for group in profile:
            assert group.tag in ('topics', 'services')
            rights = {'topics': {'publish', 'subscribe'}, 'services': {'request', 'reply'}}[group.tag]
            assert group.attrib.keys() <= rights
            assert set(group.attrib.values()) == {'ALLOW'}
            assert {each.tag for each in group} == {group.tag.removesuffix('s')}


def test_the_bridge_offers_one_service_and_may_do_nothing_more(noon_bridge):
    noon_bridge.connect()
    graph, node = noon_bridge.node, 'greenhouse_bridge'
    namespace = noon_bridge.service_name.partition('/greenhouse_bridge/')[0]

    def services():
        if (node, namespace) not in graph.get_node_names_and_namespaces():
            return set()
        return names(graph.get_service_names_and_types_by_node(node, namespace), node, namespace)

    replies = allowed(node, 'services', 'reply')
    wait_until(lambda: services() >= replies - NOT_EVERYWHERE)
    assert services() | NOT_EVERYWHERE == replies
    of_any_node = names(graph.get_service_names_and_types_by_node('bridge_test', '/'), 'bridge_test', '')
    assert services() - of_any_node == {'get_tag_reading'}
    published = {name for name, _ in graph.get_publisher_names_and_types_by_node(node, namespace)}
    assert published == allowed(node, 'topics', 'publish') == {'/parameter_events', '/rosout'}
    assert graph.get_subscriber_names_and_types_by_node(node, namespace) == []
    assert graph.get_client_names_and_types_by_node(node, namespace) == []


@pytest.mark.parametrize(('arguments', 'asks_for_parameters'), [(['1'], False), (['--all'], True)])
def test_the_client_may_do_what_it_does_and_nothing_more(
    noon_bridge, read_tag_here, monkeypatch, arguments, asks_for_parameters
):
    noon_bridge.connect()
    graph, node = noon_bridge.node, 'read_tag'
    requests = {name.rpartition('/')[2] for name in allowed(node, 'services', 'request')}
    if not asks_for_parameters:
        requests.remove('get_parameters')
    looks = []

    def asked():
        if (node, '/') not in graph.get_node_names_and_namespaces():
            return set()
        return {name.rpartition('/')[2] for name, _ in graph.get_client_names_and_types_by_node(node, '/')}

    def look(_seconds):
        """Look at the graph while read_tag waits for the next round."""
        wait_until(lambda: asked() >= requests)
        assert asked() == requests
        served = names(graph.get_service_names_and_types_by_node(node, '/'), f'/{node}', '')
        assert {name.rpartition('/')[2] for name in served} <= allowed(node, 'services', 'reply')
        published = {name for name, _ in graph.get_publisher_names_and_types_by_node(node, '/')}
        assert published <= allowed(node, 'topics', 'publish')
        assert graph.get_subscriber_names_and_types_by_node(node, '/') == []
        looks.append(True)
        signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr(process, 'sleep', look)
    wait_until(lambda: (node, '/') not in graph.get_node_names_and_namespaces())  # of the test before
    ended = read_tag_here(*arguments, '--watch', '1', '--service', noon_bridge.service_name)
    assert (ended.code, looks) == (0, [True])


@pytest.mark.parametrize(
    ('keystore', 'fragment'),
    [
        ('', 'security is enabled, but ROS_SECURITY_KEYSTORE is not set: set it to the path of the keystore'),
        ('nowhere', 'security is enabled (ROS_SECURITY_ENABLE): check the enclave'),
        # The Fast DDS of the wheels has no security; elsewhere these keys are invalid.
        ('keys', 'security is enabled (ROS_SECURITY_ENABLE): check the enclave'),
    ],
)
def test_a_start_without_usable_keys_is_one_line(
    run_here, bridge_here, tmp_path, monkeypatch, keystore, fragment
):
    enclave = tmp_path / 'keys/enclaves/greenhouse_bridge'
    enclave.mkdir(parents=True)
    for name in ('identity_ca.cert', 'cert', 'key', 'permissions_ca.cert'):
        (enclave / f'{name}.pem').write_text('none')
    for name in ('governance', 'permissions'):
        (enclave / f'{name}.p7s').write_text('none')
    monkeypatch.setenv('ROS_SECURITY_ENABLE', 'true')
    monkeypatch.setenv('ROS_SECURITY_STRATEGY', 'Enforce')
    monkeypatch.setenv('ROS_SECURITY_KEYSTORE', str(tmp_path / keystore) if keystore else '')
    bridge = bridge_here('--enclave', '/greenhouse_bridge')
    assert fragment in bridge.refusal
    assert 'RuntimeWarning' not in bridge.err

    ended = run_here(read_tag.main, '1', '--ros-args', '--enclave', '/greenhouse_bridge')
    assert ended.code == 2
    assert fragment in ended.said


def test_read_tag_names_security_among_the_causes(run_here, monkeypatch):
    """Without enforcement, a node without keys starts but finds no other node."""
    monkeypatch.setenv('ROS_SECURITY_ENABLE', 'true')
    monkeypatch.setenv('ROS_SECURITY_STRATEGY', 'Permissive')
    ended = run_here(read_tag.main, '1', '--service', '/nobody/get_tag_reading', '--timeout', '0.01')
    assert ended.code == 3
    assert 'the bridge needs the same keystore, and keys for this domain' in ended.said
