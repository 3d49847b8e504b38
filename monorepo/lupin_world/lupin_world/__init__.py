"""A simulated greenhouse to drive in, made from the layout that the bridge serves."""
