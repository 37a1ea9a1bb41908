"""Networks written for other runtimes: ONNX files, built from the weights operator by operator."""
