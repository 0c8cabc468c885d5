"""The Missing-Effect Bench: experiments that hide an effect, for any program to name it, and a score. See README.md."""
