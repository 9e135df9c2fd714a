set(page_sha256 Oq/qCA7ryib2Aj1rlWTsfQe2OjFAMBPh/3hDwO1xqeE=)
set(live_sha256 XrjOHOF6CEPTvhvumhvEN2a4bCfWwT7L7IKCIWSigGA=)
set(viewer_sha256 KCO7cSSeai+oVvwFEmSe3F6WcU/MPJ86nJKsc/fAQV4=)
