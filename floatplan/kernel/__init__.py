"""The compiled kernel: C++, how it is built and loaded, and what crosses to it. It knows arrays alone."""
