"""The instrument: apertures, noise, scans, and the measurement."""

from gonio.instrument.instrument import Instrument as Instrument
