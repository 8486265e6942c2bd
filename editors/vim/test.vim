" vim -es -u NONE -i NONE --cmd 'let g:editors = "PATH" | let g:said = "FILE"' -S test.vim: the files
" load, and every word has its group. Writes what it has to say to a file; ends with 1 if something is wrong.

set nocompatible encoding=utf-8
let s:complaints = []
let s:cases = []

function s:expect(text, word, group) abort
  call add(s:cases, [a:text, a:word, a:group])
endfunction

" Looks at all lines at once: without a screen vim does not follow changes.
function s:look() abort
  call setline(1, map(copy(s:cases), 'v:val[0]') + ['psi(F) = 1  # the names of tensors are known beside it'])
  syntax clear
  unlet! b:current_syntax
  runtime syntax/piola.vim
  for l:i in range(len(s:cases))
    let [l:text, l:word, l:group] = s:cases[l:i]
    let l:found = synIDattr(synID(l:i + 1, match(l:text, '\V' . escape(l:word, '\')) + 1, 1), 'name')
    if l:found !~# l:group
      call add(s:complaints, l:word . ' of "' . l:text . '" is ' . l:found . ', expected ' . l:group)
    endif
  endfor
endfunction

" Each word of a list, and its Greek spelling.
function s:each(list, before, after, group) abort
  for l:word in a:list
    call s:expect(a:before . l:word . a:after, l:word . a:after, a:group)
    if has_key(s:words.greek, l:word)
      call s:expect(a:before . s:words.greek[l:word] . a:after, s:words.greek[l:word] . a:after, a:group)
    endif
  endfor
endfunction

function s:test() abort
  execute 'set runtimepath^=' . fnameescape(g:editors . '/vim')
  filetype plugin on
  syntax enable
  let s:words = json_decode(join(readfile(g:editors . '/words.json'), "\n"))
  execute 'edit ' . fnameescape(tempname() . '.piola')
  if &filetype !=# 'piola' || b:current_syntax !=# 'piola' || &commentstring !=# '# %s'
    call add(s:complaints, 'ftdetect, syntax or ftplugin did not load')
  endif
  for l:word in s:words.keywords.statements + s:words.keywords.clauses
    call s:expect(l:word . ' x', l:word, '^piola\(Declaration\|Statement\|Include\|Break\)$')
  endfor
  call s:each(s:words.keywords.choice, 'x = ', ' y', '^piolaConditional$')
  call s:each(s:words.keywords.logic, 'x = y ', ' y', '^piolaLogic$')
  call s:each(s:words.heads, '', '(l) = 1', '^piolaEnergy$')
  call s:each(s:words.weights, 'weights ', '', '^piolaWeights$')
  for l:list in values(s:words.functions)
    call s:each(l:list, '1 + ', '(x)', '^piolaFunction$')
  endfor
  call s:each(s:words.constants, '1 + ', '', '^piolaConstant$')
  call s:each(s:words.measures + s:words.parts + s:words.tensors, '1 + ', '', '^piolaMeasure$')
  for l:unit in s:words.units
    for l:prefix in [''] + s:words.prefixes
      call s:expect('y = 1 in ' . l:prefix . l:unit, l:prefix . l:unit, '^piolaUnitName$')
    endfor
  endfor
  call s:expect('y = x + 2.5e-3', '2.5e-3', '^piolaNumber$')
  call s:expect('y = x + .5', '.5', '^piolaNumber$')
  call s:expect('source "text"', '"text"', '^piolaString$')
  call s:expect('y = x # text', '# text', '^piolaComment$')
  call s:expect('S(x) = x', 'S', '^piolaDefinedFunction$')
  call s:expect('parameter mu in Pa', 'mu', '^piolaDeclared$')
  call s:expect('y = S(x)', 'S', '^piolaUser$')
  for l:name in ['exp', 'sum', 'lambda1', 'µ', 'λ1', 'inn', 'iff', 't']
    call s:expect('1 + ' . l:name, l:name, '^$')
  endfor
  call s:look()
endfunction

try
  call s:test()
catch
  call add(s:complaints, v:exception . ' at ' . v:throwpoint)
endtry
if empty(s:complaints)
  call writefile(['vim: the files load, ' . len(s:cases) . ' words have their groups'], g:said)
  qall!
endif
call writefile(s:complaints[:39], g:said)
cquit!
