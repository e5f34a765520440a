"""Video to trajectory: the built-in producer ``vision``.

Nothing here imports OpenCV until a video is opened; install it with the extra ``vision``.
"""
