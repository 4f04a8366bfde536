"""Small changes of Python code that a test should notice: the classical operators of mutation testing."""

import ast
import bisect
import itertools
import re
from collections.abc import Iterator
from dataclasses import dataclass

_COMPARISONS: dict[type[ast.cmpop], tuple[str, str]] = {
    ast.Lt: ("<", "<="),
    ast.LtE: ("<=", ">"),
    ast.Gt: (">", ">="),
    ast.GtE: (">=", "<"),
    ast.Eq: ("==", "!="),
    ast.NotEq: ("!=", "=="),
    ast.Is: ("is", "is not"),
    ast.IsNot: ("is not", "is"),
    ast.In: ("in", "not in"),
    ast.NotIn: ("not in", "in"),
}
_ARITHMETIC: dict[type[ast.operator], tuple[str, str]] = {
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "/"),
    ast.Div: ("/", "*"),
    ast.FloorDiv: ("//", "*"),
    ast.Mod: ("%", "+"),
    ast.Pow: ("**", "*"),
    ast.MatMult: ("@", "+"),
    ast.BitAnd: ("&", "|"),
    ast.BitOr: ("|", "&"),
    ast.LShift: ("<<", ">>"),
    ast.RShift: (">>", "<<"),
}
_CALLS = {"min": "max", "sin": "cos", "argmin": "argmax", "any": "all", "floor": "ceil", "minimum": "maximum"}
_CALLS |= {other: name for name, other in _CALLS.items()}
# What no test of behaviour can notice: texts, types, logs, errors that the interpreter would raise anyway.
_SILENT = (ast.Raise, ast.JoinedStr, ast.Import, ast.ImportFrom, ast.Assert)


@dataclass(frozen=True)
class Mutation:
    """A replacement in one line of a module.

    The line has a number, counted from 1 when the mutation was drawn, and a text, by which it is found after other
    lines moved it. The column of the replaced text is in bytes of UTF-8.
    """

    line: int
    text: str
    column: int
    before: str
    after: str


def mutations(source: bytes) -> list[Mutation]:
    """Return every mutation of a module that the operators know, in the order of its text."""
    found = _Finder(source.splitlines(keepends=True)).of(ast.parse(source))
    return sorted(set(found), key=lambda mutation: (mutation.line, mutation.column, mutation.after))


def mutated(source: bytes, mutation: Mutation) -> bytes:
    """Return the module with one mutation; raise a ValueError if no line has its text."""
    lines = source.splitlines(keepends=True)
    same = [index for index, line in enumerate(lines) if line.decode().rstrip() == mutation.text]
    if not same:
        raise ValueError(f"no line says {mutation.text.strip()!r} any more")
    index = min(same, key=lambda index: abs(index + 1 - mutation.line))
    end = mutation.column + len(mutation.before.encode())
    lines[index] = lines[index][: mutation.column] + mutation.after.encode() + lines[index][end:]
    return b"".join(lines)


class _Finder:
    def __init__(self, lines: list[bytes]) -> None:
        self._lines, self._source = lines, b"".join(lines)
        self._starts = [0, *itertools.accumulate(len(line) for line in lines)]

    def of(self, node: ast.AST) -> Iterator[Mutation]:
        if isinstance(node, _SILENT) or _is_log(node):
            return
        yield from self._at(node)
        for name, value in ast.iter_fields(node):
            if name in ("annotation", "returns", "decorator_list", "type_params"):
                continue
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from self.of(child)

    def _at(self, node: ast.AST) -> Iterator[Mutation]:
        """Yield the mutations of a node itself, not of what it holds."""
        yield from self._of_operators(node)
        yield from self._of_values(node)
        yield from self._of_statements(node)

    def _of_operators(self, node: ast.AST) -> Iterator[Mutation]:
        match node:
            case ast.Compare(left=left, ops=ops, comparators=others):
                for (first, second), operator in zip(itertools.pairwise([left, *others]), ops, strict=True):
                    yield from self._between(first, second, *_COMPARISONS[type(operator)])
            case ast.BinOp(left=left, op=operator, right=right) if type(operator) in _ARITHMETIC:
                if not _is_text(left) and not _is_text(right):
                    yield from self._between(left, right, *_ARITHMETIC[type(operator)])
            case ast.AugAssign(target=target, op=operator, value=value) if type(operator) in _ARITHMETIC:
                yield from self._between(target, value, *(f"{sign}=" for sign in _ARITHMETIC[type(operator)]))
            case ast.BoolOp(op=operator, values=values):
                signs = ("and", "or") if isinstance(operator, ast.And) else ("or", "and")
                for first, second in itertools.pairwise(values):
                    yield from self._between(first, second, *signs)
            case ast.UnaryOp(op=ast.Not() | ast.USub(), operand=operand):
                yield from self._replaced(self._start(node), self._start(operand), "")

    def _of_values(self, node: ast.AST) -> Iterator[Mutation]:
        match node:
            case ast.Constant(value=bool(value)):
                yield from self._replaced(self._start(node), self._end(node), str(not value))
            case ast.Constant(value=int(number)):
                yield from self._replaced(self._start(node), self._end(node), str(number + 1))
            case ast.Constant(value=float(number)):
                yield from self._replaced(self._start(node), self._end(node), repr(2.0 * number if number else 1.0))
            case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name) as called) if name in _CALLS:
                yield from self._replaced(self._end(called) - len(name), self._end(called), _CALLS[name])

    def _of_statements(self, node: ast.AST) -> Iterator[Mutation]:
        match node:
            case ast.Expr(value=ast.Call()):
                yield from self._replaced(self._start(node), self._end(node), "pass")
            case ast.Continue():
                yield from self._replaced(self._start(node), self._end(node), "break")
            case ast.Break():
                yield from self._replaced(self._start(node), self._end(node), "continue")

    def _between(self, first: ast.AST, second: ast.AST, before: str, after: str) -> Iterator[Mutation]:
        begin, end = self._end(first), self._start(second)
        pattern = rf"(?<![\w*/<>=!]){re.escape(before)}(?![\w*/=])".encode()
        hits = [
            hit
            for hit in re.finditer(pattern, self._source[begin:end])
            if b"#" not in self._source[begin : begin + hit.start()]
        ]
        if len(hits) == 1:
            yield from self._replaced(begin + hits[0].start(), begin + hits[0].end(), after)

    def _replaced(self, start: int, end: int, after: str) -> Iterator[Mutation]:
        index = bisect.bisect_right(self._starts, start) - 1
        if end <= self._starts[index + 1]:
            text = self._lines[index].decode().rstrip()
            before = self._source[start:end].decode()
            yield Mutation(index + 1, text, start - self._starts[index], before, after)

    def _start(self, node: ast.AST) -> int:
        return self._starts[node.lineno - 1] + node.col_offset  # type: ignore[attr-defined]

    def _end(self, node: ast.AST) -> int:
        return self._starts[node.end_lineno - 1] + node.end_col_offset  # type: ignore[attr-defined]


def _is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str))


def _is_log(node: ast.AST) -> bool:
    called = node.func if isinstance(node, ast.Call) else None
    return isinstance(called, ast.Attribute) and called.attr in ("debug", "info", "warning", "exception")
