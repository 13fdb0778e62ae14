"""A naive agent finds out, by touching itself, that it has a body: self-touch on Drake."""

__version__ = "0.1.0"
