"""A graph as a function in LLVM's language: loops over the axes of the directions, the innermost in vectors.

Each operation stands in the outermost loop whose axis it needs, so what depends on parameters alone is computed once
for a call, and what depends on one direction once for it.
"""

import struct
from collections.abc import Sequence
from typing import NamedTuple

from gonio.models.compiled.elementary.quotients import Refinement, refined
from gonio.models.compiled.graph import COMPARISONS, DTYPES, FLOATS, Graph, Node, Unsupported

TYPES = {"f32": "float", "f64": "double", "i32": "i32", "i64": "i64", "i1": "i1"}
ORDERED = {"lt": "olt", "le": "ole", "gt": "ogt", "ge": "oge", "eq": "oeq", "ne": "une"}
SIGNED = {"lt": "slt", "le": "sle", "gt": "sgt", "ge": "sge", "eq": "eq", "ne": "ne"}
NUMBER_BYTES = {"f32": 4, "f64": 8, "i32": 4, "i64": 8}
FUSED = {"add": "fadd contract", "sub": "fsub contract", "mul": "fmul contract", "div": "fdiv"}
EXACT = {"add_exact": "fadd", "sub_exact": "fsub", "mul_exact": "fmul"}
INTRINSICS = {"sqrt": "sqrt", "abs": "fabs", "floor": "floor", "rint": "rint", "fma": "fma"}
ARITHMETIC = ("add", "sub", "mul", "and", "or", "xor", "shl", "ashr")


class Input(NamedTuple):
    """An array that the loops read: the kind of its numbers, and the axes of the loops that it has, outermost first."""

    dtype: str
    axes: tuple[int, ...]
    step: int = 1
    """Numbers of the array from one element of the innermost loop to the next."""


class Kernel(NamedTuple):
    """What is to be written: a graph, its results (channels), the arrays it reads, and the shape of the loops."""

    graph: Graph
    outputs: tuple[int, ...]
    inputs: tuple[Input, ...]
    axes: int
    lanes: int
    estimates: bool
    """Whether the processor has AVX-512's estimates of 1/x and 1/√x."""
    flush: bool
    """Whether it has SSE's control register, by which numbers below the normal ones are taken for 0, as XLA has it."""


def module(kernel: Kernel, attributes: str) -> str:
    """The text of a module with the function
    ``i32 kernel(parameters*, inputs**, output*, start, stop, sizes*)`` over start..stop of the outermost axis.

    Behind the sizes stands 1, or 0 for results that go past the caches, on processors that can.

    Its result is 0 unless a condition of the graph was false. The innermost range has to hold a vector at least.
    """
    return Writer(kernel).text(attributes)


class Writer:
    may_stream = True
    """Whether the function can be asked to write past the caches, by a 0 behind the sizes."""

    def __init__(self, kernel: Kernel) -> None:
        self.kernel, self.graph = kernel, kernel.graph
        self.streams = self.may_stream and kernel.flush  # which only processors have that can
        self.lines: list[list[str]] = [[] for _ in range(kernel.axes + 1)]
        self.declared: set[str] = set()
        self.count = 0
        self.output = "%output"
        self.levels = self._levels()
        self.refined, self.inverse_roots = set[int](), set[int]()
        if kernel.estimates:
            inner = [k for k, level in self.levels.items() if level == kernel.axes]
            self.refined, self.inverse_roots = refined(self.graph, inner)

    def _levels(self) -> dict[int, int]:
        """Of each node that a result needs, how many loops stand around it."""
        nodes, needed = self.graph.nodes, set[int]()
        pending = [*self.results(), *self.graph.required]
        while pending:
            node = pending.pop()
            if node not in needed:
                needed.add(node)
                pending.extend(nodes[node].arguments)
        levels: dict[int, int] = {}
        for k in sorted(needed):
            level = 1 + max(self.kernel.inputs[nodes[k].value].axes, default=-1) if nodes[k].op == "input" else 0
            levels[k] = max([level, *(levels[a] for a in nodes[k].arguments)])
        return levels

    def results(self) -> Sequence[int]:
        """The nodes that the function is for."""
        return self.kernel.outputs

    def arrays(self) -> int:
        """How many arrays the function is given."""
        return len(self.kernel.inputs)

    def vector(self, dtype: str) -> str:
        return f"<{self.kernel.lanes} x {TYPES[dtype]}>"

    def name(self, node: int) -> str:
        made = self.graph.nodes[node]
        return f"%n{node}" if made.op != "constant" else f"splat ({TYPES[made.dtype]} {literal(made)})"

    def typed(self, node: int) -> str:
        return f"{self.vector(self.graph.dtype(node))} {self.name(node)}"

    def temporary(self, level: int, code: str) -> str:
        self.count += 1
        self.lines[level].append(f"  %t{self.count} = {code}")
        return f"%t{self.count}"

    def operation(self, k: int) -> str:
        """The instruction of a node."""
        op, dtype, arguments, _ = self.graph.nodes[k]
        kind = self.graph.dtype(arguments[-1])
        names, operand = ", ".join(self.name(a) for a in arguments), self.vector(kind)
        floating = kind in FLOATS
        if k in self.refined or k in self.inverse_roots:
            return self.refinement(k)
        if op in COMPARISONS:
            if kind == "i1" and op not in ("eq", "ne"):
                raise Unsupported("an order of truth values")
            predicate = f"fcmp {ORDERED[op]}" if floating else f"icmp {SIGNED[op]}"
            return f"{predicate} {operand} {names}"
        if op == "select":
            return f"select {', '.join(self.typed(a) for a in arguments)}"
        if floating and op in FUSED | EXACT:
            return f"{(FUSED | EXACT)[op]} {operand} {names}"
        if op in INTRINSICS and floating:
            return self.call(INTRINSICS[op], dtype, arguments)
        if op == "neg":
            return f"fneg {operand} {names}" if floating else f"sub {operand} zeroinitializer, {names}"
        if op in ARITHMETIC and not floating:
            return f"{op} {operand} {names}"
        if op == "bits":
            return f"bitcast {operand} {names} to {self.vector(dtype)}"
        if op == "convert":
            return f"{conversion(kind, dtype)} {operand} {names} to {self.vector(dtype)}"
        raise Unsupported(f"{op} of {kind}")

    def refinement(self, k: int) -> str:
        """The last instruction of a quotient or a root from an estimate; those before it are written."""
        op, dtype, arguments, _ = self.graph.nodes[k]
        level, lines = self.levels[k], self.lines[self.levels[k]]
        code = Refinement(dtype, lambda text: self.temporary(level, text), self.declared.add)
        names = [self.literal(a, dtype) for a in arguments]
        if k in self.inverse_roots:
            result = code.inverse_root(names[0], self.name(self.graph.nodes[arguments[1]].arguments[0]))
        else:
            result = code.quotient(*names) if op == "div" else code.root(names[0])
        return lines.pop().removeprefix(f"  {result} = ")

    def literal(self, node: int, dtype: str) -> str:
        """The name of a node, or 1 as refinements know it."""
        one = self.graph.known(node) and self.graph.value(node) == 1
        return f"splat ({TYPES[dtype]} 1.0)" if one else self.name(node)

    def call(self, intrinsic: str, dtype: str, arguments: Sequence[int]) -> str:
        function = f"@llvm.{intrinsic}.v{self.kernel.lanes}{dtype}"
        self.declared.add(
            f"declare {self.vector(dtype)} {function}({', '.join([self.vector(dtype)] * len(arguments))})"
        )
        return f"call {self.vector(dtype)} {function}({', '.join(self.typed(a) for a in arguments)})"

    def splat(self, level: int, result: str, scalar: str, kind: str) -> None:
        """A number in every lane."""
        lanes, one = self.kernel.lanes, TYPES[kind]
        first = self.temporary(level, f"insertelement <{lanes} x {one}> poison, {one} {scalar}, i64 0")
        order = ", ".join(["i32 0"] * lanes)
        self.lines[level].append(
            f"  {result} = shufflevector <{lanes} x {one}> {first}, <{lanes} x {one}> poison, <{lanes} x i32> <{order}>"
        )

    def read(self, k: int) -> None:
        """The lines that load a parameter, or an element of an input."""
        op, dtype, _, index = self.graph.nodes[k]
        level, kind = self.levels[k], TYPES[dtype]
        if op == "parameter":
            place = self.temporary(0, f"getelementptr inbounds double, ptr %parameters, i64 {index}")
            value = self.temporary(0, f"load double, ptr {place}, align 8, !invariant.load !0")
            narrow = {"f64": "", "f32": "fptrunc double {} to float"}.get(dtype, "fptosi double {} to " + kind)
            self.splat(0, f"%n{k}", self.temporary(0, narrow.format(value)) if narrow else value, dtype)
            return
        axes = self.kernel.inputs[index].axes
        offset = "0"
        for axis in axes:
            if offset == "0":
                offset = f"%i{axis}"
            else:
                scaled = self.temporary(level, f"mul i64 {offset}, %size{axis}")
                offset = self.temporary(level, f"add i64 {scaled}, %i{axis}")
        place = self.temporary(level, f"getelementptr inbounds {kind}, ptr %in{index}, i64 {offset}")
        if level == self.kernel.axes and self.kernel.inputs[index].step > 1:
            self.gather(k, offset)
        elif level == self.kernel.axes:
            size = 4 if dtype == "f32" else 8
            load = f"load {self.vector(dtype)}, ptr {place}, align {size}, !alias.scope !2"
            self.lines[level].append(f"  %n{k} = {load}")
        else:
            self.splat(level, f"%n{k}", self.temporary(level, f"load {kind}, ptr {place}, !alias.scope !2"), dtype)

    def gather(self, k: int, offset: str) -> None:
        """The lines that load numbers which do not lie side by side."""
        _, dtype, _, index = self.graph.nodes[k]
        level, kind, lanes, step = self.levels[k], TYPES[dtype], self.kernel.lanes, self.kernel.inputs[index].step
        first = self.temporary(level, f"mul i64 {offset}, {step}")
        base = self.temporary(level, f"getelementptr inbounds {kind}, ptr %in{index}, i64 {first}")
        places = ", ".join(f"i64 {step * lane}" for lane in range(lanes))
        pointers = self.temporary(level, f"getelementptr inbounds {kind}, ptr {base}, <{lanes} x i64> <{places}>")
        vector, function = self.vector(dtype), f"@llvm.masked.gather.v{lanes}{dtype}.v{lanes}p0"
        self.declared.add(f"declare {vector} {function}(<{lanes} x ptr>, i32, <{lanes} x i1>, {vector})")
        size = 4 if dtype == "f32" else 8
        arguments = f"<{lanes} x ptr> {pointers}, i32 {size}, <{lanes} x i1> splat (i1 true), {vector} poison"
        self.lines[level].append(f"  %n{k} = call {vector} {function}({arguments})")

    def finish(self) -> None:
        """The lines that put the results into memory, past the caches where that is asked for and they are aligned."""
        if not self.streams:
            self.store()
            return
        place, values = self.placed()
        lines, dtype = self.lines[self.kernel.axes], self.graph.dtype(self.kernel.outputs[0])
        within = self.temporary(self.kernel.axes, f"ptrtoint ptr {place} to i64")
        within = self.temporary(self.kernel.axes, f"or i64 {within}, %cached")
        within = self.temporary(self.kernel.axes, f"and i64 {within}, {self.vector_bytes(dtype) - 1}")
        past = self.temporary(self.kernel.axes, f"icmp eq i64 {within}, 0")
        lines += [f"  br i1 {past}, label %past, label %through", "past:"]
        self.write(place, values, self.vector_bytes(dtype), ", !nontemporal !4")
        lines += ["  br label %stored", "through:"]
        self.write(place, values, NUMBER_BYTES[dtype])
        lines += ["  br label %stored", "stored:"]

    def store(self) -> None:
        """Results side by side: channels are the fastest axis of the output."""
        self.write(*self.placed(), NUMBER_BYTES[self.graph.dtype(self.kernel.outputs[0])])

    def vector_bytes(self, dtype: str) -> int:
        """Of one vector."""
        return self.kernel.lanes * NUMBER_BYTES[dtype]

    def write(self, place: str, values: list[str], align: int, how: str = "") -> None:
        """The lines that store vectors one behind another."""
        level, dtype = self.kernel.axes, self.graph.dtype(self.kernel.outputs[0])
        for part, value in enumerate(values):
            here = self.temporary(
                level, f"getelementptr inbounds {TYPES[dtype]}, ptr {place}, i64 {part * self.kernel.lanes}"
            )
            self.lines[level].append(
                f"  store {self.vector(dtype)} {value}, ptr {here}, align {align}, !noalias !2{how}"
            )

    def placed(self) -> tuple[str, list[str]]:
        """Where the results of this vector of elements go, and the vectors that go there."""
        outputs, lanes, level = self.kernel.outputs, self.kernel.lanes, self.kernel.axes
        channels, dtype = len(outputs), self.graph.dtype(outputs[0])
        offset = "%i0"
        for axis in range(1, level):
            scaled = self.temporary(level, f"mul i64 {offset}, %size{axis}")
            offset = self.temporary(level, f"add i64 {scaled}, %i{axis}")
        offset = self.temporary(level, f"mul i64 {offset}, {channels}")
        sources = [[divmod(part * lanes + lane, channels) for lane in range(lanes)] for part in range(channels)]
        values = [self.interleaved(source) for source in sources]
        place = self.temporary(level, f"getelementptr inbounds {TYPES[dtype]}, ptr {self.output}, i64 {offset}")
        return place, values

    def interleaved(self, source: list[tuple[int, int]]) -> str:
        """A vector with the wanted lane of the wanted channel in each lane."""
        outputs, lanes = self.kernel.outputs, self.kernel.lanes
        channels = sorted({channel for _, channel in source})
        if len(outputs) == 1:
            return self.name(outputs[0])
        kind = self.vector(self.graph.dtype(outputs[0]))
        value = "poison"
        for channel in channels:
            order = [lanes + lane if c == channel else k for k, (lane, c) in enumerate(source)]
            mask = ", ".join(f"i32 {o}" for o in order)
            value = self.temporary(
                self.kernel.axes,
                f"shufflevector {kind} {value}, {kind} {self.name(outputs[channel])}, <{lanes} x i32> <{mask}>",
            )
        return value

    def check(self) -> str:
        """The result of the function: whether a condition was false anywhere."""
        level = self.kernel.axes
        flags = [self.name(k) for k in self.graph.required]
        kind = self.vector("i1")
        good = flags[0]
        for flag in flags[1:]:
            good = self.temporary(level, f"and {kind} {good}, {flag}")
        reduce = f"@llvm.vector.reduce.and.v{self.kernel.lanes}i1"
        self.declared.add(f"declare i1 {reduce}({kind})")
        bad = self.temporary(level, f"xor i1 {self.temporary(level, f'call i1 {reduce}({kind} {good})')}, true")
        wide = self.temporary(level, f"zext i1 {bad} to i32")
        before = self.temporary(level, "load i32, ptr %status")
        self.lines[level].append(f"  store i32 {self.temporary(level, f'or i32 {before}, {wide}')}, ptr %status")
        return "%final"

    def text(self, attributes: str) -> str:
        for k, level in self.levels.items():
            node = self.graph.nodes[k]
            if node.op == "constant":
                continue
            if node.op in ("input", "parameter"):
                self.read(k)
            else:
                self.lines[level].append(f"  %n{k} = {self.operation(k)}")
        if self.kernel.flush:
            self.declared |= {f"declare void @llvm.x86.sse.{name}(ptr)" for name in ("stmxcsr", "ldmxcsr")}
        if self.graph.required:
            self.check()
        self.finish()
        head, loops = self.head(), self.loops()
        return "\n".join([*head, *loops, *sorted(self.declared), *TAIL, f"attributes #0 = {{ {attributes} }}"])

    def head(self) -> list[str]:
        arguments = (
            "ptr noalias %parameters, ptr noalias %inputs, ptr noalias %output, i64 %start, i64 %stop, ptr %sizes"
        )
        lines = [
            f"define i32 @kernel({arguments}) #0 {{",
            "entry:",
            "  %status = alloca i32",
            "  store i32 0, ptr %status",
        ]
        lines += FLUSH if self.kernel.flush else []
        for k in range(self.arrays()):
            lines += [f"  %slot{k} = getelementptr ptr, ptr %inputs, i64 {k}", f"  %in{k} = load ptr, ptr %slot{k}"]
        for axis in range(self.kernel.axes):
            lines += [
                f"  %sp{axis} = getelementptr i64, ptr %sizes, i64 {axis}",
                f"  %size{axis} = load i64, ptr %sp{axis}",
            ]
        if self.streams:
            lines += [f"  %sp = getelementptr i64, ptr %sizes, i64 {self.kernel.axes}", "  %cached = load i64, ptr %sp"]
        return lines

    def loops(self) -> list[str]:
        """One loop in another; the last vector of the innermost begins early, so that it ends with the range."""
        last, lines = self.kernel.axes - 1, list(self.lines[0])
        for axis in range(self.kernel.axes):
            begin, end = ("%start", "%stop") if axis == 0 else ("0", f"%size{axis}")
            before = "entry" if axis == 0 else f"loop{axis - 1}"
            lines += [f"  br label %loop{axis}", f"loop{axis}:"]
            lines += [f"  %c{axis} = phi i64 [ {begin}, %{before} ], [ %next{axis}, %end{axis} ]"]
            if axis == last:
                lines += [f"  %edge = sub i64 {end}, {self.kernel.lanes}", f"  %over = icmp sgt i64 %c{axis}, %edge"]
                lines += [f"  %i{axis} = select i1 %over, i64 %edge, i64 %c{axis}"]
            else:
                lines += [f"  %i{axis} = add i64 %c{axis}, 0"]
            lines += self.lines[axis + 1]
        for axis in reversed(range(self.kernel.axes)):
            end, step = ("%stop" if axis == 0 else f"%size{axis}"), (self.kernel.lanes if axis == last else 1)
            after = "exit" if axis == 0 else f"end{axis - 1}"
            lines += [f"  br label %end{axis}"] if axis == last else []
            lines += [f"end{axis}:", f"  %next{axis} = add i64 %c{axis}, {step}"]
            lines += [f"  %more{axis} = icmp slt i64 %next{axis}, {end}"]
            lines += [f"  br i1 %more{axis}, label %loop{axis}, label %{after}"]
        restored = ["  call void @llvm.x86.sse.ldmxcsr(ptr %control)"] if self.kernel.flush else []
        if self.streams:
            self.declared.add("declare void @llvm.x86.sse.sfence()")
            restored.append("  call void @llvm.x86.sse.sfence()")
        return [*lines, "exit:", *restored, "  %final = load i32, ptr %status", "  ret i32 %final", "}"]


FLUSH = (
    "  %control = alloca i32", "  %flushing = alloca i32", "  call void @llvm.x86.sse.stmxcsr(ptr %control)",
    "  %before = load i32, ptr %control", "  %with = or i32 %before, 32832", "  store i32 %with, ptr %flushing",
    "  call void @llvm.x86.sse.ldmxcsr(ptr %flushing)",
)  # fmt: skip
TAIL = ("!0 = !{}", '!1 = distinct !{!1, !"inputs"}', '!3 = distinct !{!3, !1, !"read"}', "!2 = !{!3}", "!4 = !{i32 1}")


def conversion(source: str, target: str) -> str:
    """The instruction that turns one kind of number into another."""
    if source in FLOATS and target in FLOATS:
        return "fpext" if target == "f64" else "fptrunc"
    if source in FLOATS:
        return "fptosi"
    if target in FLOATS:
        return "sitofp"
    return "sext" if target == "i64" else "trunc"


def literal(node: Node) -> str:
    """A constant; a float as the bits of the double of the same value."""
    if node.dtype == "i1":
        return "true" if node.value else "false"
    if node.dtype in FLOATS:
        return f"0x{struct.unpack('<Q', struct.pack('<d', float(node.value)))[0]:016X}"
    return str(int(DTYPES[node.dtype](node.value)))
