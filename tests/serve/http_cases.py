"""A client of the service in the same process, and its token."""

import warnings

with warnings.catch_warnings():  # it prefers a successor of httpx
    warnings.simplefilter("ignore")
    from fastapi.testclient import TestClient as TestClient

TOKEN = "0123456789abcdef0123456789abcdef"
BEARER = {"Authorization": f"Bearer {TOKEN}"}
