"""The hypotheses about the odometry at a scan: it is right, it is faulty, or it is again as before a fault.

Each gives a prior of the laser's pose, from which a scan that does not fit is registered again. See `odometry_fault`
for their probabilities.
"""

import math
from typing import NamedTuple

import numpy as np

from tbmslam.geometry.se2 import SE2, FloatArray, wrap_angle
from tbmslam.kernels.surfels.determined import prior_information
from tbmslam.tracking.odometry_fault import RESTART_COST, OdometryFault, faulty_cost
from tbmslam.tracking.odometry_noise import Deviations
from tbmslam.tracking.student_t import student_cost
from tbmslam.tracking.tracker import PosePrior

_SWERVE = 0.1
"""A step of the odometry that differs more from the robot's last motion may be a fault: registration converges from no
farther away [m]. Inertia counts only then, since the last poses may be wrong if people walk beside the robot. With
0.05 the error in a simulated hospital with a crowd is 0.2 m instead of 0.02 m."""
_SAME_START = 0.05
"""Starts that are nearer to each other need one search, which covers half a metre around [m], [rad]."""


class PoseBelief(NamedTuple):
    """A belief about the laser's pose in the map's frame, of Student's t distribution."""

    mean: SE2
    information: FloatArray
    """Inverse scale (3, 3)."""

    @classmethod
    def of(cls, T_map_robot: SE2, deviations: Deviations, T_robot_sensor: SE2) -> "PoseBelief":
        """Return the belief about the laser's pose by the robot's pose and its deviations (along, across, heading)."""
        mount = (*T_robot_sensor,)
        return cls(T_map_robot @ T_robot_sensor, prior_information(deviations, T_map_robot.theta, mount))

    def squared_distance(self, pose: SE2) -> float:
        """Return the squared Mahalanobis distance of a pose from the mean."""
        (x, y, theta), mean = pose, self.mean
        error = np.array([x - mean.x, y - mean.y, wrap_angle(theta - mean.theta)])
        return float(error @ self.information @ error)

    def is_near(self, other: "PoseBelief") -> bool:
        """Return whether a search about one mean includes the other."""
        apart = self.mean.to(other.mean)
        return math.hypot(apart.x, apart.y) < _SAME_START and abs(apart.theta) < _SAME_START


class OdometryHypotheses(NamedTuple):
    """The laser's pose by each hypothesis about the odometry, and the costs of the hypotheses."""

    right: PoseBelief
    """By right odometry."""
    inertia: PoseBelief | None
    """By the robot's inertia, if the odometry is faulty; None where the last pose is too old."""
    returned: PoseBelief | None
    """By odometry that began anew, or is again as before a fault; None if neither is suspected."""
    faulty_cost: float
    """Cost of any pose under faulty odometry, less that of the mean of right odometry; infinite without inertia."""
    returned_cost: float
    """Cost of the mean of `returned`, less that of the mean of right odometry."""
    is_suspected: bool
    """Whether the odometry may be faulty; else the others are only where a registration starts."""

    @classmethod
    def of(cls, prior: PosePrior, T_robot_sensor: SE2, fault: OdometryFault) -> "OdometryHypotheses":
        """Return the hypotheses by a prior and the probability of a fault."""
        right = PoseBelief.of(prior.mean, prior.deviations, T_robot_sensor)
        coasting, inertia, faulty = prior.coasting(), None, math.inf
        if coasting is not None:
            inertia = PoseBelief.of(*coasting, T_robot_sensor)
            faulty = faulty_cost(prior.deviations, coasting.deviations)
        returned, cost = None, math.inf
        if prior.stood is not None:
            (pose, deviations), cost = prior.stood, RESTART_COST
        elif prior.by_odometry and (found := fault.returned(prior.mean, prior.deviations)) is not None:
            (pose, deviations), cost = found, 0.0
        if cost < math.inf:
            returned = PoseBelief.of(pose, deviations, T_robot_sensor)
            cost += math.log(math.prod(deviations) / math.prod(prior.deviations))
        return cls(right, inertia, returned, faulty, cost, may_be_faulty(prior, fault))

    def costs(self, pose: SE2, surprise: float) -> tuple[float, float, float]:
        """Return the arguments of `OdometryFault.cost` for a pose and its squared distance from right odometry."""
        cost = self.returned_cost
        if self.returned is not None:
            cost += student_cost(self.returned.squared_distance(pose))
        return surprise, self.faulty_cost, cost

    def cost(self, pose: SE2, surprise: float, fault: OdometryFault) -> float:
        """Return the negative logarithm of the prior of a pose, up to a constant; for `surprise` see `costs`."""
        inertia = self.inertia
        if not self.is_suspected or (inertia is None and self.returned is None):
            return student_cost(surprise)
        cost = fault.cost(*self.costs(pose, surprise))
        return cost if inertia is None else cost + student_cost(inertia.squared_distance(pose))


def may_be_faulty(prior: PosePrior, fault: OdometryFault) -> bool:
    """Return whether the odometry suddenly leaves the robot's last motion, or was faulty a short time ago."""
    return prior.swerve > _SWERVE or prior.stood is not None or fault.is_suspected
