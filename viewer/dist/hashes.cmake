set(page_sha256 zRUpxcWODcFmxyHefPkvXkGRGx9kfGD9MBhmob5K2rM=)
set(live_sha256 Zj47aLmNA7VarPT/qZtRN1a3SY+2DKC/S8O9eK3QcMI=)
set(viewer_sha256 GqVJP4GH1qRXhi8kpg+wH+KoWGx3VA+tKPhKPfb32Tc=)
