"""Work in threads: results in order, and none started for a single item."""

import threading
import time

import pytest

from gash_jax.files.cores import available_cores, in_threads


@pytest.mark.parametrize("workers", [None, 1, 3, 100])
def test_results_are_in_the_order_of_the_items(workers: int | None) -> None:
    def late(item: int) -> int:
        time.sleep(0.001 * (9 - item))
        return item * item

    assert in_threads(late, range(10), workers) == [item * item for item in range(10)]
    assert in_threads(late, iter([]), workers) == []


def test_threads_are_started_where_there_is_work_for_them() -> None:
    meet = threading.Barrier(2, timeout=60)
    assert len(set(in_threads(lambda _: (meet.wait(), threading.get_ident())[1], range(2), 2))) == 2
    for items, workers in (([1], None), ([1, 2], 1)):
        assert set(in_threads(lambda _: threading.get_ident(), items, workers)) == {threading.get_ident()}
    assert available_cores() >= 1


def test_what_fails_in_a_thread_is_raised() -> None:
    with pytest.raises(ZeroDivisionError):
        in_threads(lambda item: 1 // item, [1, 0], 2)
