"""Entry point: errors as one line on standard error, and exit status."""

from __future__ import annotations

import io
import signal
import sys
from typing import Final

import typer

from bess.cli.app import app
from bess.errors import BessError, InputError, StoppedEarly

DONE: Final = 0
FAILED: Final = 1
BAD_INPUT: Final = 2
STOPPED: Final = 3

# typer carries its own copy of click since 0.26; this finds the base of usage errors in either.
_UsageError: Final = typer.BadParameter.__bases__[0]


def main() -> None:
    """Run the command line and exit with its status."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # some terminals have no degree sign
    # Outside the closed loop SIGTERM ends the program the way Ctrl-C does.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    sys.exit(_status())


def _status() -> int:
    try:
        return app(prog_name="bess", standalone_mode=False) or DONE
    except InputError as error:
        return _say(str(error), BAD_INPUT)
    except StoppedEarly as error:
        return _say(str(error), STOPPED)
    except BessError as error:
        return _say(str(error), FAILED)
    except (typer.Abort, KeyboardInterrupt):
        return _say("stopped; saved results are kept, continue with --resume", STOPPED)
    except BrokenPipeError:
        sys.stderr.close()
        return FAILED
    except Exception as error:
        if isinstance(error, _UsageError):
            message = getattr(error, "format_message", error.__str__)()
            place = getattr(getattr(error, "ctx", None), "command_path", "bess")
            return _say(f"{message.replace('Value error, ', '')} (see {place} --help)", BAD_INPUT)
        raise


def _say(message: str, status: int) -> int:
    print("bess: " + " ".join(message.split()), file=sys.stderr)
    return status
