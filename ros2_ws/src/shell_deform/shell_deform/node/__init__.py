"""The deformation node with its topics, parameters and messages: the only room with rclpy."""
