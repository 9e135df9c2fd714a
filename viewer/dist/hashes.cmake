set(page_sha256 Oe00/wOUbmF4kdWw9b18F5vTo3Z16JP0OCQ4UyFUnww=)
set(viewer_sha256 4mzQ4/InxadqV3dtXKpezszloc/dG3YdhjusY/qgK+U=)
