"""Functions on several threads: order of the results, and calls from within such threads."""

import threading

from cradle_env.threads import in_threads


def test_results_are_in_the_order_of_the_items():
    """The first item ends last: it waits for the second."""
    second_done = threading.Event()

    def function(item):
        if item == 0:
            assert second_done.wait(10.0)
        else:
            second_done.set()
        return item**2

    assert in_threads(function, [0, 1, 2], 2) == [0, 1, 4]


def test_a_call_from_a_thread_of_a_pool_stays_on_it():
    """More threads than asked for would only wait for each other."""

    def outer(_):
        return threading.get_ident(), in_threads(lambda _: threading.get_ident(), range(4), 2)

    for own, inner in in_threads(outer, range(4), 2):
        assert set(inner) == {own} != {threading.get_ident()}
    assert set(in_threads(lambda _: threading.get_ident(), range(4), 1)) == {threading.get_ident()}


def test_threads_that_few_calls_leave_idle_serve_the_calls_within():
    """Two calls, four threads: each has two."""
    both = threading.Barrier(4)  # that of four threads at once: with fewer it breaks

    def outer(_):
        return in_threads(lambda _: both.wait(10.0), range(2), 4)

    assert sorted(order for inner in in_threads(outer, range(2), 4) for order in inner) == [0, 1, 2, 3]
