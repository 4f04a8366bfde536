"""Which topics belong to the robot whose scans are read, where a bag holds several robots."""

from collections.abc import Callable, Sequence


def of_same_robot(names: Sequence[str], scan: str, other_scans: Sequence[str]) -> list[str]:
    """Return the topics that are not another robot's, in their order.

    Robots in one bag have namespaces: /robot_1/tf belongs to /robot_1/scan, whatever its frames are called. What lies
    nearer to other scans is another robot's; so is what lies beside other scans where the robot has a topic of its own.

    Parameters
    ----------
    names
        Topics of one kind.
    scan
        The topic of scans that was chosen.
    other_scans
        The bag's other topics of scans.
    """
    nearness = nearness_to(scan)
    others = [nearness_to(other) for other in other_scans]
    own = [name for name in names if all(near(name) <= nearness(name) for near in others)]
    nearest = max(map(nearness, own), default=0)
    homes = {_namespace(other) for other in other_scans} - {_namespace(scan)}
    return [name for name in own if nearness(name) == nearest or _namespace(name) not in homes]


def nearness_to(scan: str) -> Callable[[str], int]:
    """Return the function that says how many names of its namespace a topic shares with one of scans."""
    home = _namespace(scan)

    def shared(name: str) -> int:
        common = 0
        for one, other in zip(_namespace(name), home, strict=False):
            if one != other:
                break
            common += 1
        return common

    return shared


def is_plain_odom(name: str, scan: str) -> bool:
    """Return whether a topic is called odom, in the namespace of scans or in one around it."""
    return name.rsplit("/", 1)[-1] == "odom" and len(_namespace(name)) == nearness_to(scan)(name)


def _namespace(name: str) -> tuple[str, ...]:
    """Return the names before a topic's own."""
    return tuple(name.strip("/").split("/")[:-1])
