"""The tree of frames in a recording, and the choice of the odometry frame and the robot's frame."""

import math
from collections import deque
from dataclasses import dataclass, field

from datasets.odometry.se3 import SE3
from datasets.options import RecordingOptions

# Frames above the odometry. A localiser publishes the edges below these, and they jump.
_LOCALISED_FRAMES = ("map", "world", "earth", "utm", "gt", "ground_truth", "mocap")
_ODOM_FRAMES = ("odom_combined", "odom", "odometry", "odom_frame")
_ROBOT_FRAMES = ("base_footprint", "base_link", "base")
KEPT_LAGS = 500


def plain(frame: str) -> str:
    """Return a frame's name without leading slashes."""
    return frame.lstrip("/")


def is_localised(frame: str) -> bool:
    """Return whether a frame belongs to a map rather than to the odometry."""
    return _last(plain(frame)).lower() in _LOCALISED_FRAMES


def is_of_robot(frame: str) -> bool:
    """Return whether a frame has a usual name of the robot's frame."""
    return _last(plain(frame)) in _ROBOT_FRAMES


@dataclass
class Edge:
    """The surveyed transforms of one edge; `first` transforms coordinates from child to parent."""

    parent: str
    child: str
    static: bool
    first: SE3
    count: int = 0
    moves: bool = False
    """Whether any transform differed from the first."""
    lags: list[float] = field(default_factory=list)
    """Bag time minus stamp of the first transforms [s]."""

    @property
    def is_fixed(self) -> bool:
        """Whether its first transform holds for the whole recording: it is static, or there is no other."""
        return self.static or self.count == 1

    @property
    def key(self) -> tuple[str, str]:
        """Names of parent and child."""
        return self.parent, self.child


@dataclass(frozen=True)
class Step:
    """One edge on a path; `down` goes from parent to child."""

    edge: Edge
    down: bool


class FrameGraph:
    """All edges seen in a recording."""

    def __init__(self) -> None:
        self.edges: dict[tuple[str, str], Edge] = {}

    def add(self, parent: str, child: str, pose: SE3, static: bool, lag: float) -> None:
        """Add one transform; its lag is nan if its stamp is unset."""
        key = (plain(parent), plain(child))
        edge = self.edges.setdefault(key, Edge(*key, static, pose))
        edge.count += 1
        edge.moves = edge.moves or any(abs(a - b) > 1e-6 for a, b in zip(pose, edge.first, strict=True))
        if len(edge.lags) < KEPT_LAGS and math.isfinite(lag):
            edge.lags.append(lag)

    def frames(self) -> list[str]:
        """Return the names of all frames, sorted."""
        return sorted({frame for key in self.edges for frame in key})

    def path(self, start: str, end: str, through_localised: bool = False) -> list[Step] | None:
        """Return the shortest path between two frames, whose product is T_start_end; None if there is no path."""
        arrived_by: dict[str, tuple[str, Step] | None] = {start: None}
        waiting = deque([start])
        while waiting and end not in arrived_by:
            here = waiting.popleft()
            for edge in self.edges.values():
                if here not in (edge.parent, edge.child):
                    continue
                down = edge.parent == here
                there = edge.child if down else edge.parent
                blocked = is_localised(edge.parent) and not through_localised
                if there not in arrived_by and not blocked:
                    arrived_by[there] = (here, Step(edge, down))
                    waiting.append(there)
        if end not in arrived_by:
            return None
        steps: list[Step] = []
        link = arrived_by[end]
        while link is not None:
            here, step = link
            steps.append(step)
            link = arrived_by[here]
        return steps[::-1]

    def ancestors(self, frame: str) -> list[str]:
        """Return the frame and its ancestors, without frames of a localiser."""
        chain = [frame]
        while True:
            above = [p for p, c in self.edges if c == chain[-1] and not is_localised(p) and p not in chain]
            if not above:
                return chain
            chain.append(above[0])

    def doubts(self, steps: list[Step]) -> list[str]:
        """Return a warning for each frame of a path that has two parents in tf or several places in tf_static."""
        warnings = []
        for edge in (step.edge for step in steps):
            name = f"{edge.child} in {edge.parent}"
            if edge.static and edge.moves:
                warnings.append(
                    f"tf_static states several places of {name}; the first is used: pass --sensor-pose if it is wrong"
                )
            parents = {parent for parent, child in self.edges if child == edge.child and not is_localised(parent)}
            if rivals := sorted(parents - {edge.parent}):
                remedy = "--sensor-pose" if edge.is_fixed else "--odom-frame"
                warnings.append(
                    f"tf places {name} and in {', '.join(rivals)}; the former is used: pass {remedy} if it is wrong"
                )
        return warnings


@dataclass(frozen=True)
class Frames:
    """The chosen frames and the paths between them; `to_sensor` is None if tf does not hold the laser."""

    odom: str
    robot: str
    to_robot: list[Step]
    to_sensor: list[Step] | None


def choose_frames(graph: FrameGraph, sensor: str, options: RecordingOptions) -> Frames | None:
    """Find the odometry frame and the robot's frame in tf; None if tf holds no odometry.

    The odometry frame is the requested frame, or the first of these relative to which the robot moves: a frame of a
    usual name; a frame with `odom` in its name; the topmost frame above the laser that is not a localiser's.
    The robot's frame is the first of these: the requested frame; base_footprint or base_link on the path to the laser;
    the end of the first edge that is not static.
    """
    for odom in _odom_candidates(graph, sensor, options):
        localised = is_localised(odom)
        robots = [options.robot_frame] if options.robot_frame else _robot_candidates(graph, odom, sensor, localised)
        for robot in robots:
            to_robot = graph.path(odom, plain(robot), localised)
            if to_robot and any(not step.edge.is_fixed for step in to_robot):
                return Frames(odom, plain(robot), to_robot, graph.path(plain(robot), sensor, localised))
    return None


def find_robot_frame(graph: FrameGraph, sensor: str, options: RecordingOptions, hint: str | None) -> str | None:
    """Return the frame whose pose an odometry topic states: the requested one, the topic's own, or the usual name."""
    if options.robot_frame:
        return plain(options.robot_frame)
    if hint and graph.path(plain(hint), sensor) is not None:
        return plain(hint)
    usual = [
        frame
        for name in _ROBOT_FRAMES
        for frame in graph.frames()
        if _last(frame) == name and graph.path(frame, sensor) is not None
    ]
    return usual[0] if usual else plain(hint or "") or None


def _last(frame: str) -> str:
    """Return a frame's name without its namespace."""
    return frame.rsplit("/", 1)[-1]


def _odom_candidates(graph: FrameGraph, sensor: str, options: RecordingOptions) -> list[str]:
    """Return frames that may be the odometry's, best first."""
    if options.odom_frame:
        return [plain(options.odom_frame)]
    frames = graph.frames()
    named = [frame for name in _ODOM_FRAMES for frame in frames if _last(frame) == name]
    named += [frame for frame in frames if "odom" in _last(frame) and frame not in named]
    named.sort(key=lambda frame: graph.path(frame, sensor) is None)
    top = graph.ancestors(sensor)[-1]
    path = graph.path(top, sensor) or []
    return named if top in named or not any(step.edge.moves for step in path) else [*named, top]


def _robot_candidates(graph: FrameGraph, odom: str, sensor: str, localised: bool) -> list[str]:
    """Return frames that may be the robot's, best first."""
    path = graph.path(odom, sensor, localised)
    if not path:
        below = [f for name in _ROBOT_FRAMES for f in graph.frames() if _last(f) == name]
        return [*below, *(child for parent, child in graph.edges if parent == odom)]
    on_way = [step.edge.child if step.down else step.edge.parent for step in path]
    usual = [frame for name in _ROBOT_FRAMES for frame in on_way if _last(frame) == name]
    moving = [frame for frame, step in zip(on_way, path, strict=True) if not step.edge.is_fixed]
    return [*usual, *moving[:1]]
