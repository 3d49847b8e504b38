"""Start the bridge on its own domain and read every tag over ROS; exit code 0 only if all were read."""

import os
import subprocess
import sys
from pathlib import Path

import domain_coordinator
from jobs import end

EXECUTABLES = Path(os.environ['LUPIN_EXECUTABLES'])
TIMEOUT_SECONDS = 60


def main() -> int:
    """Run the bridge and read_tag --all; return the first exit code that is not 0."""
    with domain_coordinator.domain_id() as domain_id:
        environment = {
            **os.environ,
            'ROS_DOMAIN_ID': str(domain_id),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
            'ROS_DISCOVERY_SERVER': '',  # it may be off, and nobody else is needed
        }
        with subprocess.Popen([EXECUTABLES / 'bridge_node'], env=environment) as bridge:
            try:
                reading = subprocess.run(
                    [EXECUTABLES / 'read_tag', '--all', '--timeout', str(TIMEOUT_SECONDS // 2)],
                    env=environment,
                    timeout=TIMEOUT_SECONDS,
                    check=False,
                )
                bridge.terminate()
                return reading.returncode or bridge.wait(TIMEOUT_SECONDS)
            except subprocess.TimeoutExpired as error:
                print(f'smoke: {error}', file=sys.stderr)
                return 1
            finally:
                bridge.kill()


if __name__ == '__main__':
    end(main, 'smoke')
