"""The compiled kernel: C++, how it is built and loaded, what crosses to it, and the numbers that it keeps to."""
