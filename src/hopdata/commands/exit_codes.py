"""What a command's exit code says; argparse itself ends with 2 on a wrong command line."""

OK, PROBLEM, USAGE, INTERRUPTED = 0, 1, 2, 130
