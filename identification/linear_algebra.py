"""Linear algebra on one thread: several would be in the way of threads that simulate, and would round by how many they
are, so that the same readings led to other fits on another machine."""

from threadpoolctl import threadpool_limits

on_one_thread = threadpool_limits.wrap(limits=1, user_api="blas")
