"""From pixels to lengths: scale bars, planes, cameras, and pairs of cameras."""
