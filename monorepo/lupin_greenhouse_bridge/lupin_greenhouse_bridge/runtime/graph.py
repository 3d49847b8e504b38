# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""Find other nodes and their services in the ROS graph."""

import contextlib
import os
from collections.abc import Callable

from rclpy.node import Node, NodeNameNonExistentError


def domain_id() -> str:
    """Return the ROS domain of this process, as text."""
    return os.environ.get('ROS_DOMAIN_ID') or '0'


def namesake_warning(node: Node) -> str:
    """Return a warning if another node has the full name of this one; '' otherwise."""
    own = node.get_name(), node.get_namespace()
    if node.get_node_names_and_namespaces().count(own) < 2:
        return ''
    return (
        f'another node named {node.get_fully_qualified_name()} is on domain {domain_id()}, so others get'
        ' the replies and messages of both: stop one of them, or start one with its own namespace or'
        ' ROS_DOMAIN_ID'
    )


def nodes_with(
    full_name: str, node: Node, names_and_types_of: Callable[[str, str], list[tuple[str, list[str]]]]
) -> list[str]:
    """
    Return the sorted full names of the nodes that have this service, client or topic; a name can come twice.

    `names_and_types_of` is the method of `node` that lists what a node has.
    """
    found = []
    for name, namespace in node.get_node_names_and_namespaces():
        with contextlib.suppress(NodeNameNonExistentError):  # the node has just ended
            if full_name in dict(names_and_types_of(name, namespace)):
                found.append(f'{namespace.rstrip("/")}/{name}')
    return sorted(found)


def servers_of(node: Node, service_name: str) -> list[str]:
    """Return the sorted full names of the nodes that offer a service; two nodes can have the same name."""
    full_name = node.resolve_service_name(service_name)
    return nodes_with(full_name, node, node.get_service_names_and_types_by_node)


def duplicate_server_warning(node: Node, service_name: str) -> str:
    """
    Return a warning if several nodes offer a service; '' otherwise.

    Nodes with the same name count as one node: ROS lists a node twice for some seconds after it was killed
    and restarted.
    """
    servers = servers_of(node, service_name)
    if len(set(servers)) < 2:
        return ''
    name, names = node.resolve_service_name(service_name), ' and '.join(servers)
    return f'{name} is offered by {names}: clients use the first reply; stop one of them, or rename it'
