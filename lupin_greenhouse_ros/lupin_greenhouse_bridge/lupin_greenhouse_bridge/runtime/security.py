# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""What may be wrong with the security settings of this process."""

import os


def security_problem() -> str:
    """Return what may be wrong with the security settings; '' if SROS2 is not enabled."""
    if os.environ.get('ROS_SECURITY_ENABLE') != 'true':
        return ''
    if not os.environ.get('ROS_SECURITY_KEYSTORE'):
        return 'security is enabled, but ROS_SECURITY_KEYSTORE is not set: set it to the path of the keystore'
    return (
        'security is enabled (ROS_SECURITY_ENABLE): check the enclave (--enclave or'
        ' ROS_SECURITY_ENCLAVE_OVERRIDE) in the keystore, and that the RMW was built with security'
    )
