"""Serves files over MAVLink FTP, read only: `from companion.link.ftp.server import FtpServer`."""
