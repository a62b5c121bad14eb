"""The video of the MAVLink camera: a process that serves it by RTSP, and what the stream shows when."""
