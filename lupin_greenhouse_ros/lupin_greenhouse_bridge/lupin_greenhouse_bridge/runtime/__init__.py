# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""What every node needs: its process, parameters and launch file. Imports no other folder of the package."""
