"""From a graph to an ONNX file."""

from __future__ import annotations

from pathlib import Path

from tvae.export.engines import IR_VERSION, OPSET, check_operators
from tvae.export.ports import Graph, Port
from tvae.export.sheet import Sheet, needed
from tvae.files import appearing


def write_onnx(graph: Graph, path: Path) -> tuple[str, ...]:
    """Write a graph, whole or not at all, and return the names of the operators that it uses.

    Raises `ExportError` where a package is missing, and `ValueError` for an operator that not every engine has.
    """
    onnx = needed("onnx")
    sheet = Sheet()
    found = graph.write({port.name: sheet.value(port.name) for port in graph.inputs})
    for port in graph.outputs:
        sheet.name(found[port.name], port.name)
    operators = tuple(sorted({node.op_type for node in sheet.nodes}))
    check_operators(operators, graph.name)

    def declared(port: Port) -> object:
        kind = onnx.TensorProto.INT64 if port.dtype == "int64" else onnx.TensorProto.FLOAT
        return onnx.helper.make_tensor_value_info(port.name, kind, port.shape)

    inputs, outputs = [declared(port) for port in graph.inputs], [declared(port) for port in graph.outputs]
    body = onnx.helper.make_graph(sheet.nodes, graph.name, inputs, outputs, sheet.constants)
    model = onnx.helper.make_model(body, opset_imports=[onnx.helper.make_opsetid("", OPSET)], producer_name="tvae")
    model.ir_version = IR_VERSION
    onnx.checker.check_model(model, full_check=True)
    with appearing(path, overwrite=True) as partial:
        partial.write_bytes(model.SerializeToString(deterministic=True))
    return operators
