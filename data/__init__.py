"""What is kept and exchanged: tables, their files, foreign formats."""

from gonio.data.flags import Flag as Flag
from gonio.data.formats.registry import read as read
from gonio.data.layout import Layout as Layout
from gonio.data.table import Block as Block
from gonio.data.table import Channels as Channels
from gonio.data.table import Table as Table
