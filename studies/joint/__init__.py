"""Joint posteriors of a run and three instruments, on data whose truth is known."""
