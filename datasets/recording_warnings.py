"""What a reader of a map should know about the recording it was made of."""

from datasets.counts import ReadingCounts, Span, gaps_in_words
from datasets.recording import Recording

_DROPPED = {
    "before_odometry": "they came before the first odometry",
    "impossible_angles": "their angles are impossible",
    "empty": "they were empty",
    "duplicate": "they were there twice",
    "unreadable": "they could not be read",
    "other_frame": "they came from another laser on the same topic",
}
_MANY = 0.01
"""Share of all scans beyond which it is worth saying that so many have something odd."""


def recording_warnings(recording: Recording, span: Span | None = None) -> list[str]:
    """Return a sentence for everything odd that the last pass over a recording met; nothing where all was well.

    Parameters
    ----------
    recording
        The recording.
    span
        The mapped part of it; None: all of it. Gaps are those of the part; other counts have no times and are those of
        knows when they were, of the whole recording.
    """
    counts = recording.counts
    counted = _counted(counts) + _beam_warnings(counts)
    if span is not None:
        counted = [f"in the whole recording, {what}" for what in counted]
    pauses = counts.pauses_in(span)
    warnings = counted + ([f"{gaps_in_words(pauses)}: motion during a gap is unknown"] if pauses else [])
    if recording.description.get("sensor_pose_known") is False:
        warnings.append("the mount of the laser on the robot is not recorded: a default was used")
    frames = recording.description.get("frame_warnings")
    warnings += [str(warning) for warning in frames] if isinstance(frames, list) else []
    first_scan = recording.description.get("first_scan")
    is_given = recording.description.get("angle_step_deg") is not None  # then the stated angle is not used
    angle = first_scan.get("angle_warning") if isinstance(first_scan, dict) and not is_given else None
    return warnings + [str(warning) for warning in (recording.description.get("clock_warning"), angle) if warning]


def _counted(counts: ReadingCounts) -> list[str]:
    warnings = [
        f"{number} of {counts.scans_read} scans were dropped: {_DROPPED.get(reason, reason)}"
        for reason, number in sorted(counts.dropped.items())
    ]
    warnings += [
        f"{number} scans {what}"
        for number, what in (
            (counts.backward_stamps, "are stamped earlier than the scan before: the clock stepped back"),
            (counts.same_stamps, "have the stamp of an earlier scan"),
            (counts.clock_disagreements, "are stamped by another clock than the rest of the recording"),
            (counts.extrapolated, "came after the last odometry, which was extrapolated"),
            (counts.without_odometry, "had no odometry, so scan matching alone estimated the motion"),
            (counts.doubtful_sweeps, "state an impossible time between beams"),
        )
        if number
    ]
    if (code := counts.likely_code()) is not None:
        warnings.append(
            f"{counts.farthest_beams} beams end at exactly {code:.6g} m, the longest range of all, which may be a "
            f"code for no return: try --no-return-code {code:.6g}"
        )
    if counts.beam_count_changes:
        warnings.append(f"the number of beams changed {counts.beam_count_changes} times")
    if counts.lost_scans:
        warnings.append(f"about {counts.lost_scans} scans, {counts.lost_seconds:.1f} s, are lost in a damaged file")
    return warnings


def _beam_warnings(counts: ReadingCounts) -> list[str]:
    total = sum(counts.beams.values())
    return [
        f"{counts.beams[fate] / total:.0%} of the beams {what}"
        for fate, what in (
            ("nan", "are not a number"),
            ("zero", "are zero"),
            ("too_close", "are below the least range of the laser"),
        )
        if counts.beams.get(fate, 0) > _MANY * total
    ]
