"""Tests of many readings at a stated level, where a reading may be a count of photons."""
