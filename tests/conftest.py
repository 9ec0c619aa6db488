"""What holds for all tests."""

import signal

# A shell starts background jobs with Ctrl-C ignored, which their children inherit; tests send Ctrl-C to theirs.
signal.signal(signal.SIGINT, signal.default_int_handler)
