"""Start the bridge on its own domain and read every tag over ROS; exit code 0 only if all were read."""

import os
import subprocess
import sys

import domain_coordinator
from lupin_greenhouse_bridge.runtime.process import private_domains, variables_of_private_domain


def main() -> int:
    """Run the bridge and read_tag --all; return the first exit code that is not 0."""
    with domain_coordinator.domain_id(private_domains()) as domain_id:
        os.environ.update(variables_of_private_domain(domain_id))
        with subprocess.Popen(['bridge_node']) as bridge:
            try:
                reading = subprocess.run(['read_tag', '--all', '--timeout', '30'], check=False)
            finally:
                bridge.terminate()
            return reading.returncode or bridge.wait()


if __name__ == '__main__':
    sys.exit(main())
