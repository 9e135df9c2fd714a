set(page_sha256 rWkhwGF/gz8SrLy3LWQq4g47MQNlDRc/O3FGjdlyW9E=)
set(live_sha256 givrUIb3D/GqFiMbufZf+CrjR5IpsND9bdS4yAEabwo=)
set(viewer_sha256 kWiMutEztsNtqLh17imWKj784rSUgutoWPFQD+R5Sus=)
