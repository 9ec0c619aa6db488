"""A busy machine must not answer with the fallback of the service, unless a test asks for it."""

PATIENT = {"service.answer_within_s": 10.0}
