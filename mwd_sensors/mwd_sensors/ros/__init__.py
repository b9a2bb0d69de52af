"""What every node of the graph is built from: lifecycle, parameters, QoS, message buffers."""
