"""An ONNX graph that is written as arithmetic: values are added, multiplied and gathered, and nodes come of it.

Opset 15: an older one is read by more programs. It takes the axes of sums as an input and those of means and maxima as
an attribute. Whatever is not float32 says so. Weights in float16 stand in the
file as they are and are cast once.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from onnx import TensorProto, helper, numpy_helper  # type: ignore[import-not-found]

OPSET, IR_VERSION = 15, 8
FLOAT, INT32 = TensorProto.FLOAT, TensorProto.INT32
TYPES = {"float32": FLOAT, "int32": INT32}
NEVER = -1e30  # a logit that counts for nothing; infinities are not kept by every graphics card

Axis = int | str  # a number, or the name of an axis that may have any length


class Value:
    """A result within a graph; the other operand may be a number or a NumPy array."""

    __array_ufunc__ = None  # NumPy leaves arithmetic to the methods below

    def __init__(self, graph: "Graph", name: str):
        self.graph, self.name = graph, name

    def __add__(self, other: Any) -> "Value":
        return self.graph.add("Add", self, other)

    def __radd__(self, other: Any) -> "Value":
        return self.graph.add("Add", other, self)

    def __sub__(self, other: Any) -> "Value":
        return self.graph.add("Sub", self, other)

    def __rsub__(self, other: Any) -> "Value":
        return self.graph.add("Sub", other, self)

    def __mul__(self, other: Any) -> "Value":
        return self.graph.add("Mul", self, other)

    def __rmul__(self, other: Any) -> "Value":
        return self.graph.add("Mul", other, self)

    def __truediv__(self, other: Any) -> "Value":
        return self.graph.add("Div", self, other)

    def __rtruediv__(self, other: Any) -> "Value":
        return self.graph.add("Div", other, self)

    def __matmul__(self, other: Any) -> "Value":
        return self.graph.add("MatMul", self, other)

    def __neg__(self) -> "Value":
        return self.graph.add("Neg", self)

    def __gt__(self, other: Any) -> "Value":
        return self.graph.add("Greater", self, other)

    def __lt__(self, other: Any) -> "Value":
        return self.graph.add("Less", self, other)

    def maximum(self, other: Any) -> "Value":
        """The larger of both."""
        return self.graph.add("Max", self, other)

    def minimum(self, other: Any) -> "Value":
        """The smaller of both."""
        return self.graph.add("Min", self, other)

    def clip(self, low: Any, high: Any) -> "Value":
        """Held between both."""
        return self.maximum(low).minimum(high)

    def apply(self, operator: str, **attributes: Any) -> "Value":
        """An operator of one operand, such as "Sqrt"."""
        return self.graph.add(operator, self, **attributes)

    def sum(self, axis: int, keep: bool = False) -> "Value":
        """Over one axis."""
        return self.graph.add("ReduceSum", self, np.array([axis]), keepdims=int(keep))

    def mean(self, axis: int, keep: bool = False) -> "Value":
        """Over one axis."""
        return self.apply("ReduceMean", axes=[axis], keepdims=int(keep))

    def max(self, axis: int, keep: bool = False) -> "Value":
        """Over one axis."""
        return self.apply("ReduceMax", axes=[axis], keepdims=int(keep))

    def take(self, index: Any, axis: int = 0) -> "Value":
        """Entries along an axis, by a number, an array or a value of integers."""
        return self.graph.add("Gather", self, index, axis=axis)

    def unsqueeze(self, *axes: int) -> "Value":
        """With axes of length 1 at these places of the result."""
        return self.graph.add("Unsqueeze", self, np.array(axes))

    def reshape(self, *shape: int) -> "Value":
        """In another shape: 0 keeps the length of an axis, -1 is what is left."""
        return self.graph.add("Reshape", self, np.array(shape))

    def transpose(self, *order: int) -> "Value":
        """With its axes in another order."""
        return self.apply("Transpose", perm=list(order))


class Graph:
    """The graph in the making, and the weights that it is made of by name."""

    def __init__(self, weights: Mapping[str, np.ndarray]):
        self.weights = weights
        self.inputs: list[Any] = []
        self.outputs: list[Any] = []
        self.nodes: list[Any] = []
        self.initializers: list[Any] = []
        self._known: dict[Any, Value] = {}

    def input(self, name: str, shape: Sequence[Axis], meaning: str, dtype: str = "float32") -> Value:
        """An array that whoever runs the file gives; each once."""
        if name not in self._known:
            self.inputs.append(helper.make_tensor_value_info(name, TYPES[dtype], shape, meaning))
            self._known[name] = Value(self, name)
        return self._known[name]

    def output(self, name: str, value: Value, shape: Sequence[Axis], meaning: str) -> None:
        """An array that the file gives."""
        self.nodes.append(helper.make_node("Identity", [value.name], [name]))
        self.outputs.append(helper.make_tensor_value_info(name, FLOAT, shape, meaning))

    def weight(self, name: str) -> Value:
        """An array of the model in float32."""
        key = ("weight", name)
        if key not in self._known:
            array = self.weights[name]
            self.initializers.append(numpy_helper.from_array(np.ascontiguousarray(array), name))
            value = Value(self, name)
            self._known[key] = value if array.dtype == np.float32 else value.apply("Cast", to=FLOAT)
        return self._known[key]

    def constant(self, value: Any) -> Value:
        """A number or an array: float32, or int64 where it is made of integers."""
        array = np.asarray(value)
        array = array.astype(np.int64 if array.dtype.kind in "iu" else np.float32)
        key = (array.dtype.char, array.shape, array.tobytes())
        if key not in self._known:
            name = f"constant_{len(self.initializers)}"
            self.initializers.append(numpy_helper.from_array(array, name))
            self._known[key] = Value(self, name)
        return self._known[key]

    def add(self, operator: str, *operands: Any, **attributes: Any) -> Value:
        """A node with one result. Numbers become constants, integers where the operator wants integers."""
        names = [(o if isinstance(o, Value) else self.constant(o)).name for o in operands]
        result = f"{operator.lower()}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, names, [result], **attributes))
        return Value(self, result)

    def where(self, condition: Value, yes: Any, no: Any) -> Value:
        """One or the other, entry by entry."""
        return self.add("Where", condition, yes, no)

    def concat(self, values: Sequence[Any], axis: int) -> Value:
        """One after the other along an axis."""
        return self.add("Concat", *values, axis=axis)

    def stack(self, values: Sequence[Value], axis: int = -1) -> Value:
        """Side by side along a new axis."""
        return self.concat([value.unsqueeze(axis) for value in values], axis)

    def operators(self) -> list[str]:
        """The operators in use, sorted."""
        return sorted({node.op_type for node in self.nodes})
