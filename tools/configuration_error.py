"""What is wrong with a configuration, in one line."""

from __future__ import annotations


class ConfigurationError(Exception):
    """A configuration cannot be used; the message names the file, the field, the value and what is allowed."""
