"""A model as ONNX, for game engines, browsers and anything else that has no PyTorch."""
