"""The engines that an export is for, and the operators of ONNX that each of them has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

OPSET = 15
"""Version of the set of operators."""
IR_VERSION = 8
"""Version of the file format."""


@dataclass(frozen=True)
class Engine:
    """An engine, the versions meant, the newest set of operators they read, and the operators they have."""

    name: str
    version: str
    opset: int
    operators: frozenset[str]


_IN_UNITY = """
Abs Acos Acosh Add And ArgMax ArgMin Asin Asinh Atan Atanh BatchNormalization Bernoulli Cast Ceil Celu Clip
Compress Concat Constant ConstantOfShape Cos Cosh CumSum Div Dropout Einsum Elu Equal Erf Exp Expand Flatten
Floor Gather GatherElements GatherND Gemm Greater GreaterOrEqual HardSigmoid HardSwish Hardmax Identity
InstanceNormalization IsInf IsNaN LSTM LayerNormalization LeakyRelu Less LessOrEqual Log LogSoftmax MatMul Max
Mean Min Mod Mul Multinomial Neg NonZero Not OneHot Or PRelu Pad Pow RandomNormal RandomNormalLike
RandomUniform RandomUniformLike Range Reciprocal ReduceL1 ReduceL2 ReduceLogSum ReduceLogSumExp ReduceMax
ReduceMean ReduceMin ReduceProd ReduceSum ReduceSumSquare Relu Reshape Round ScatterElements ScatterND Selu
Shape Shrink Sigmoid Sign Sin Sinh Size Slice Softmax Softplus Softsign Split Sqrt Squeeze Sub Sum Tan Tanh
ThresholdedRelu Tile TopK Transpose Trilu Unsqueeze Where Xor
"""
_EVERYWHERE = frozenset(_IN_UNITY.split())
"""Those in Unity's list; ONNX Runtime, of which the other two are made, has all operators of the standard."""

ENGINES = (
    Engine("Unity Inference Engine", "com.unity.ai.inference (Sentis) 2.1 or later, CPU backend", 15, _EVERYWHERE),
    Engine("ONNX Runtime Web", "onnxruntime-web 1.17 or later, WebAssembly backend", 20, _EVERYWHERE),
    Engine("Unreal NNE", "Unreal Engine 5.5 or later, NNERuntimeORT on the CPU", 20, _EVERYWHERE),
)


def check_operators(operators: Sequence[str], graph: str) -> None:
    """Raise `ValueError` for an operator that one of the engines does not have.

    >>> check_operators(["Add", "Loop"], "encoder")
    Traceback (most recent call last):
    ValueError: encoder uses Loop, which Unity Inference Engine does not have
    """
    for engine in ENGINES:
        missing = sorted(set(operators) - engine.operators)
        if missing:
            raise ValueError(f"{graph} uses {', '.join(missing)}, which {engine.name} does not have")
