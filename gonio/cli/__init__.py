"""The command line: one module a verb, each with `add_arguments(parser)` and `run(args) -> exit status`.

At the top of a verb's module only the standard library is imported, so that `gonio --help` is quick.
"""
