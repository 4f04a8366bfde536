"""A ROS 2 node that maps with tbmslam."""
