"""What holds for all tests."""

import signal

# Background jobs of a shell ignore Ctrl-C, and so do their children; tests send Ctrl-C to theirs.
signal.signal(signal.SIGINT, signal.default_int_handler)
