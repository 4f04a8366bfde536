"""A drive through the whole method, what it says went wrong, and a drive in which the robot is carried."""

from dataclasses import replace

from tbmslam.slam import Slam


def mapped(readings):
    slam = Slam()
    for reading in readings:
        slam.process(reading)
    return slam, slam.finish().drives[0]


def said(slam):
    return [incident.text(slam.start_stamp) for incident in slam.incidents]


def carried(robot, begin, end):
    """Carry the robot on from one reading to a later one while its wheels stand still."""
    before, after = robot.readings[begin].T_odom_robot, robot.readings[end].T_odom_robot
    moved = [replace(r, T_odom_robot=before @ after.inverse() @ r.T_odom_robot) for r in robot.readings[end:]]
    return [*robot.readings[: begin + 1], *moved]
