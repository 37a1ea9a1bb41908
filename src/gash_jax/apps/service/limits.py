"""What the service takes upon itself at most; every limit is an option of `gash serve`."""

from typing import NamedTuple


class Limits(NamedTuple):
    """Limits of one request, of what is held between requests, and of what runs at a time."""

    vertices: int = 200_000  # of a mesh; with `faces` they bound the body of a request
    faces: int = 400_000
    meshes: int = 32  # held at a time; the least recently used leaves
    memory_mib: int = 1024  # of held meshes together
    requests: int = 16  # being read, waiting or computed at a time; more are told to come again
    seconds: float = 30.0  # for the body to arrive, and for the answer to be computed


class Refusal(Exception):
    """A request that gets no coefficients: an HTTP status and one line that says what to do."""

    def __init__(self, status: int, text: str):
        super().__init__(text)
        self.status, self.text = status, text
