"""Type inference that asks once for the result of an operation.

Numba tries dozens of templates to type one operation, and does so again for each use and whenever the type of an
operand is refined: 15 194 searches for 914 different questions while intel is mapped. The answers are kept here.
"""

import operator
from typing import Any

from numba.core import typed_passes, types
from numba.core.compiler_machinery import register_pass

_signatures: dict[object, Any] = {}
"""Signatures of numba's own functions and operators by flags, function and types of arguments, with implementations."""


class _RememberedTypes:
    """A typing context that remembers the signatures of numba's own functions and operators."""

    def __init__(self, context: Any, flags: str) -> None:
        # The implementation of a function depends on the compiler's flags.
        self._context, self._flags = context, flags

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def resolve_function_type(self, function: Any, args: Any, kws: Any) -> Any:
        """Return the signature of a function for types of arguments."""
        found: Any = self._context._lookup_global(function) or function  # noqa: SLF001 - there is no public access
        is_of_numba = type(found) is types.Function and not kws
        if not is_of_numba:
            return self._context.resolve_function_type(function, args, kws)
        key = self._flags, found, tuple(args)
        if key in _signatures:
            signature, implementation = _signatures[key]
            # The back end looks here, where a compilation with other flags may have left another implementation.
            found._impl_keys[signature.args] = implementation  # noqa: SLF001 - there is no public access
            return signature
        signature = self._context.resolve_function_type(function, args, kws)
        if signature is not None:
            _signatures[key] = signature, found.get_impl_key(signature)
        return signature

    def resolve_setitem(self, target: Any, index: Any, value: Any) -> Any:
        """Return the signature of an assignment to an item."""
        return self.resolve_function_type(operator.setitem, (target, index, value), {})


@register_pass(mutates_CFG=True, analysis_only=False)
class TypeInference(typed_passes.NopythonTypeInference):
    """Numba's type inference with remembered signatures."""

    _name = "kernel_type_inference"

    def run_pass(self, state: Any) -> bool:
        """Infer the types of all variables."""
        context = state.typingctx
        state.typingctx = _RememberedTypes(context, state.flags.get_mangle_string())
        try:
            infer: Any = super().run_pass  # numba has no types
            return bool(infer(state))
        finally:
            state.typingctx = context
