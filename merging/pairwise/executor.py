"""Who aligns maps: this process, several of them, or a cluster. The alignments are the same."""

from dataclasses import dataclass, field

from tbmslam.parallel.progress import Watch


@dataclass(frozen=True)
class Executor:
    """Who does the work of a merge, and who is told of it.

    Parameters
    ----------
    workers
        Processes of this machine that share the work.
    scheduler
        Address of a Dask scheduler whose workers share it instead; None for this machine.
    watch
        Who is told how long steps take and how far they are.

    Raises
    ------
    ValueError
        If there is no worker.
    """

    workers: int = 1
    scheduler: str | None = None
    watch: Watch = field(default_factory=Watch)

    def __post_init__(self) -> None:
        """Refuse to have nobody do it."""
        if self.workers < 1:
            raise ValueError(f"workers must be at least 1, got {self.workers}")
