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
    """More threads than cores would only wait for each other."""

    def outer(_):
        return threading.get_ident(), in_threads(lambda _: threading.get_ident(), range(4), 2)

    for own, inner in in_threads(outer, range(4), 2):
        assert set(inner) == {own} != {threading.get_ident()}
    assert set(in_threads(lambda _: threading.get_ident(), range(4), 1)) == {threading.get_ident()}
