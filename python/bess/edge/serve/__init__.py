"""The service: a controller that is called over HTTP, or controls a plant itself."""

import logging
from typing import Final

LOG: Final = logging.getLogger("bess.serve")
