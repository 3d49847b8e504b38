"""What every node of ours needs: its process, its parameters, its launch file. Imports no other room."""
