"""What every node needs: its process, parameters and launch file. Imports no other folder of the package."""
