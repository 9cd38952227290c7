"""A graph as a function that adds up products over the elements of a loop, in LLVM's language."""

from collections.abc import Sequence

from gonio.models.compiled.emission import TYPES, Kernel, Writer


def sums_module(kernel: Kernel, products: Sequence[tuple[int, int]], attributes: str) -> str:
    """The text of a module with the function of `emission.module`, for one loop whose length is a multiple of a vector.

    Its output is the sums, a vector each, to which it adds; what the kernel calls outputs goes to an array whose
    address stands after those of the inputs.

    Args:
        kernel: the graph, what is stored of each element (perhaps nothing), and the arrays.
        products: pairs of nodes whose products are added up.
        attributes: of the function.
    """
    return _SumsWriter(kernel, products).text(attributes)


def adding_module(kernel: Kernel, attributes: str) -> str:
    """The text of a module that adds the kernel's outputs over its outer loop, for each element of the inner one.

    Its output has a row for each of the kernel's outputs, as long as the inner loop, to which it adds.
    """
    return _AddingWriter(kernel).text(attributes)


class _AddingWriter(Writer):
    may_stream = False

    def finish(self) -> None:
        level, inner = self.kernel.axes, self.kernel.axes - 1
        for k, node in enumerate(self.kernel.outputs):
            dtype = self.graph.dtype(node)
            vector = self.vector(dtype)
            row = self.temporary(level, f"mul i64 %size{inner}, {k}")
            first = self.temporary(level, f"add i64 {row}, %i{inner}")
            place = self.temporary(level, f"getelementptr inbounds {TYPES[dtype]}, ptr %output, i64 {first}")
            before = self.temporary(level, f"load {vector}, ptr {place}, align 8")
            after = self.temporary(level, f"fadd {vector} {before}, {self.name(node)}")
            self.lines[level].append(f"  store {vector} {after}, ptr {place}, align 8, !noalias !2")


class _SumsWriter(Writer):
    may_stream = False

    def __init__(self, kernel: Kernel, products: Sequence[tuple[int, int]]) -> None:
        self.products = products
        super().__init__(kernel)
        self.output = f"%in{len(kernel.inputs)}"

    def results(self) -> Sequence[int]:
        return [*self.kernel.outputs, *(k for pair in self.products for k in pair)]

    def arrays(self) -> int:
        return len(self.kernel.inputs) + bool(self.kernel.outputs)

    def finish(self) -> None:
        for k, (first, second) in enumerate(self.products):
            self.accumulate(k, first, second)
        if self.kernel.outputs:
            self.store()

    def accumulate(self, k: int, first: int, second: int) -> None:
        """The lines that add a product to its sum."""
        level, lanes, dtype = self.kernel.axes, self.kernel.lanes, self.graph.dtype(first)
        vector, function = self.vector(dtype), f"@llvm.fma.v{lanes}{dtype}"
        self.declared.add(f"declare {vector} {function}({', '.join([vector] * 3)})")
        place = self.temporary(level, f"getelementptr inbounds {TYPES[dtype]}, ptr %output, i64 {k * lanes}")
        before = self.temporary(level, f"load {vector}, ptr {place}, align 8")
        arguments = f"{self.typed(first)}, {self.typed(second)}, {vector} {before}"
        after = self.temporary(level, f"call {vector} {function}({arguments})")
        self.lines[level].append(f"  store {vector} {after}, ptr {place}, align 8, !noalias !2")
