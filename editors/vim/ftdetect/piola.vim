autocmd BufRead,BufNewFile *.piola setfiletype piola
