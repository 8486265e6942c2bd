" Vim filetype plugin file
" Language: piola, interaction potentials of peridynamics
" License:  MIT OR Apache-2.0

if exists('b:did_ftplugin')
  finish
endif
let b:did_ftplugin = 1

setlocal commentstring=#\ %s
setlocal comments=:#
setlocal formatoptions-=t formatoptions+=croql
setlocal iskeyword+=181

" `:make` checks the file; messages name the place as ` --> FILE:LINE:COLUMN`.
setlocal makeprg=piola\ check\ %:S
setlocal errorformat=%E%trror[%*[^]]]:\ %m,%W%tarning[%*[^]]]:\ %m,%C\ %#-->\ %f:%l:%c,%C%.%#,%-G%.%#

let b:undo_ftplugin = 'setlocal commentstring< comments< formatoptions< iskeyword< makeprg< errorformat<'
