# Generated from tools/core of the Lupin monorepo; to change it, see CONTRIBUTING.md
"""What every node of ours needs: its process, its parameters, its launch file. Imports no other room."""
